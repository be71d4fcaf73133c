"""Maps and traffic of others as folders that the simulator reads: sites."""
