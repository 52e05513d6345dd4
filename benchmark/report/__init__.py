"""What comes out: tables, figures, recordings and the gate, made from the records alone."""
