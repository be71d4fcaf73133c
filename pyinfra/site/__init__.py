"""Maps and traffic of others as site folders."""
