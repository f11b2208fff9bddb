"""Live robots: sources, the process that reads them, and who gets its readings."""
