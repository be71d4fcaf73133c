"""One module a command: `main()` reads its arguments from `sys.argv`."""
