"""The language of programs: recognised here, and written as grammars for servers."""
