"""The command `log`: files in; what they are, a page that draws them and a description out.

Order: log_settings, log_summary (figures of a log that is read), column_draft (its description, or
one of a log that is not), log_figure, log_inspection.
"""
