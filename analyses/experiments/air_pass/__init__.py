"""The experiment `air-pass`: `repeated_pass` reads both passes, `experiment` compares the laws."""
