"""The generated C in the forms that other tools take in: FMUs, libraries, modules."""
