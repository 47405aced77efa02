"""The thesis's laboratory and chapter 4 for people: folders, pages and the terminal."""
