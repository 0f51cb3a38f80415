"""Support for the tests: no test lies here."""
