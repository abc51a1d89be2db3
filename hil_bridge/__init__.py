"""The wire: rotor commands leave as DroneCAN frames, ESCs answer, the flight goes on with what came back."""
