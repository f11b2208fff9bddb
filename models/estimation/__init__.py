"""From a model and what the drives report to the wrench at the tool."""
