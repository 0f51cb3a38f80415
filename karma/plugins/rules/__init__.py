"""Rules of English for small models: parser, request checker, dialogue."""
