"""A planted plug-in that asks for the network is refused and named, as far as Python can see it."""

from support.abuse import all_held
from support.abuse.egress import PLANTED, egress


def test_planted_plug_in_is_refused_and_named_and_its_process_fails(tmp_path):
    all_held(egress, len(PLANTED), tmp_path)
