"""The command line: arguments become settings, settings become calls; nothing is computed here."""
