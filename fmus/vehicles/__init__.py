"""Vehicles as data: parameter files, their checks, and the diagnoser designs that belong to them."""

from rotordx.fmus import vehicle_names
from rotordx.fmus.vehicles.vehicle import Vehicle, VehicleError, load_design, load_vehicle

__all__ = ["Vehicle", "VehicleError", "load_design", "load_vehicle", "vehicle_names"]
