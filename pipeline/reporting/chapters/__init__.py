"""The chapters of the index page."""
