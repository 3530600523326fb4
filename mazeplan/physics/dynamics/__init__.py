"""How ball and plate move: along a ring, in the plane, and as a rigid body that rolls and spins."""
