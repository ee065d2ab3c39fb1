"""An episode as it is played: map, belief and what was thought of, as pictures and recordings."""
