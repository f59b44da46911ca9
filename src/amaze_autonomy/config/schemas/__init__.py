"""What each file may say: a schema for each of the configuration's YAML files, and the values made of it."""
