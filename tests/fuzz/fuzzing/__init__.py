"""Commands with inputs that nobody meant: run apart, with limits, and judged."""
