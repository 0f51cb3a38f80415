"""A Ray cluster of two nodes on this machine, and the processes that work there."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path


def two_nodes() -> AbstractContextManager[str]:
    """The address of a cluster of two."""
    return cluster_of(2)


@contextmanager
def cluster_of(nodes: int) -> Iterator[str]:
    """The address of a cluster; nodes have the environment of this moment.

    Ray takes 127.0.0.1 to mean the outer address.
    """
    from ray.cluster_utils import Cluster

    node = {"num_cpus": 1, "node_ip_address": "127.0.0.2", "include_dashboard": False}
    made = Cluster(initialize_head=True, connect=False, head_node_args=node)
    for _ in range(nodes - 1):
        made.add_node(num_cpus=1, node_ip_address="127.0.0.2")
    try:
        yield made.address
    finally:
        made.shutdown()


def workers_of(cluster: str) -> list[int]:
    """The processes that do jobs on a cluster: children of its raylets."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            title = (place / "cmdline").read_bytes()
            parent = (place / "stat").read_text().rpartition(")")[2].split()[1]
            above = (place.parent / parent / "cmdline").read_bytes()
        except OSError:  # it has just ended
            continue
        if title.startswith(b"ray::NodeWorker") and cluster.encode() in above:
            found.append(int(place.name))
    return found
