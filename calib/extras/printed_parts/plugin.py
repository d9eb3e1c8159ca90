"""What printed parts bring to the method: nothing that the core asks for; `inspector.extras.printed_parts` has them."""

CONTRIBUTIONS = ()
