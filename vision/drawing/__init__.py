"""Pictures of what vision did. In: views and results; out: panels to look at. Nothing else imports it."""
