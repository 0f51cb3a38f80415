"""`python -m karma.world.player`."""

from karma.world.player.main import main

raise SystemExit(main())
