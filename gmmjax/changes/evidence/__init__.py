"""Stage: candidates are examined by what the other survey knows of their places."""
