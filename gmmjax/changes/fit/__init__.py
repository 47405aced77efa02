"""Stage: one mixture is fitted to both clouds."""
