"""Quadrotor physics, once: symbolic terms and the C code generated from them."""
