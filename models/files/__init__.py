"""Files of any kind: written whole or not at all, and refused in one line.

In: paths and dataclasses. Out: their content, or an InputError. Order: input_error; limited_file,
files_read, whole_file (reading and writing); configuration, field_words, plausible_numbers (YAML
files as dataclasses); bundled_files (by name).
"""
