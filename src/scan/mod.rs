//! The input's text becomes records: OBJ and MTL in, columns and a catalogue out.
