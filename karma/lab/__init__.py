"""The policy laboratory: access traces, what each replacement policy makes of them, and figures.

    draw_errands -> Trace -> simulate -> TraceReplay -> Sweep -> figures, claims

No world runs here: a task is the units that it needs (`karma.lab.tasks`), a trace is one task after
another (`karma.lab.workloads`), and a policy sees keys only.
"""
