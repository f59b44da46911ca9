"""Topic maps: their schema, how one is proposed, and those of known recordings, one YAML file each."""
