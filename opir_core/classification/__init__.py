"""Types inferred from what bands measure: imagined launches and hot sources, their densities, and the posterior."""
