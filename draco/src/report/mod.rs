//! What a run leaves behind: table, summary, HTML page, trajectories, graph.
