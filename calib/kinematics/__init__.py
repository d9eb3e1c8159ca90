"""The five-parameter robot and its forward kinematics with Jacobian (Jang 2025, eq 3-8; Park 2022, section 2)."""
