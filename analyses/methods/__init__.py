"""What the commands call, without their options: questions and their answers."""
