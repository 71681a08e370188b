//! What an attacker may change: the input, and the files of the work folder.

mod forged;
mod hostile;
