"""From an event to what was seen: by metadata or by pictures."""
