"""The commands, one module each: `main()` reads its arguments from `sys.argv`."""
