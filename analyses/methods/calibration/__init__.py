"""What is learnt with a known model: loads, torque constants, friction of today."""
