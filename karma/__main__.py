"""`python -m karma`: the command line."""

from karma.cli import app

if __name__ == "__main__":  # worker processes import this module again
    app(prog_name="karma")
