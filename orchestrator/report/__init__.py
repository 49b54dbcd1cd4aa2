"""One page that shows what was recorded: HTML that needs nothing but a browser, and no network."""
