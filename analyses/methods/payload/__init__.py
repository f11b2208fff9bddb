"""The command `payload`: logs with a load and a model in, mass and centre of mass out.

Order: payload_config (settings), payload_identification.
"""
