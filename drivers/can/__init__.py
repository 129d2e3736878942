"""CANopen: joints are CiA 406 encoders, temperatures CiA 404 modules; one SYNC latches all."""
