"""Stage: the clouds as given are checked, cropped, and reduced to one resolution."""
