"""Contains a module for each command; its `main()` reads the arguments from `sys.argv`."""
