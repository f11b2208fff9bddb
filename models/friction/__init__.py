"""Laws of joint friction, as tables that kernels read."""
