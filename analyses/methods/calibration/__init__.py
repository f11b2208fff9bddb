"""What is learnt beside a model that is there: loads, torque constants, friction of today."""
