"""From records to figures: metrics, intervals, comparisons, tables, exports."""
