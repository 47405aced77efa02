"""Stage: both clouds are brought into the frame of the before cloud."""
