"""The console in the browser: campaigns, their cases and what runs now, as data for one page."""
