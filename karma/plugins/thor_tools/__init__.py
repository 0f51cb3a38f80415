"""AI2-THOR tools: player protocol, recorded sessions, importers of dumps and ProcTHOR."""
