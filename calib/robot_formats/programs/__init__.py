"""Joint targets as controllers and ROS read them."""
