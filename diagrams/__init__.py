"""Drake Diagrams built from `systems` and MultibodyPlant. Nothing here advances time."""
