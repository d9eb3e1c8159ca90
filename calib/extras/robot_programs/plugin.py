"""What robot programs bring to the method: nothing that core asks for; `inspector.extras.robot_programs` has them."""

CONTRIBUTIONS = ()
