//! Map-to-map transforms without a prior: where does the partner's map lie in mine?
