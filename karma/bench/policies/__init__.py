"""The policy laboratory: access traces, replays of replacement policies, and figures.

    draw_errands -> Trace -> simulate -> TraceReplay -> Sweep -> figures, claims

No world runs here: a task is the units that it needs (`tasks`), a trace is one task after another
(`workloads`), and a policy sees keys only.
"""
