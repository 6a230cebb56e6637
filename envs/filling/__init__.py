"""What fills a ring with strictly convex quadrilaterals; the front door is :mod:`envs.filling.convex_fill`."""
