"""What printed parts bring."""

from inspector.plugins import Command, PipExtra

CONTRIBUTIONS = (
    Command(
        "jig",
        "inspector.extras.printed_parts.options:JigOptions",
        "inspector.extras.printed_parts.jig_command:run_jig",
        after="sample",
    ),
    PipExtra("parts", ("manifold3d",)),
)
