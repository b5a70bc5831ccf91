use super::{RunReport, Summary};

impl RunReport {
    /// The result as a table for a terminal: a line a robot, one for the team.
    pub fn table(&self) -> String {
        let summary = self.summary();
        let kinds = self.message_kinds();
        let mut rows = vec![header(&kinds)];
        rows.extend(summary.robots.iter().map(|robot| {
            let bits = |kind: &String| kbit(robot.sent_bits.get(kind).copied().unwrap_or(0));
            let mut row = vec![
                format!("robot {}{}", robot.id, if robot.merged { "" } else { " (alone)" }),
                robot.keyframes.to_string(),
                robot.closures.proposed.to_string(),
                robot.closures.accepted.to_string(),
                robot.closures.true_accepted.map_or_else(unknown, |count| count.to_string()),
                metres(robot.ate_dead_reckoning_m),
                metres(robot.ate_m),
                kbit(robot.sent_bits.values().sum()),
            ];
            row.extend(kinds.iter().map(bits));
            row
        }));
        rows.push(team_row(&summary, &kinds));
        layout(&rows) + &footer(&summary)
    }
}

fn header(kinds: &[String]) -> Vec<String> {
    let fixed = ["", "keyframes", "proposed", "accepted", "true", "ATE before", "ATE after", "sent kbit"];
    fixed.iter().map(|&name| name.to_owned()).chain(kinds.iter().cloned()).collect()
}

fn team_row(summary: &Summary, kinds: &[String]) -> Vec<String> {
    let team = &summary.team;
    let of_kind = |kind: &String| kbit(summary.robots.iter().filter_map(|r| r.sent_bits.get(kind)).sum());
    let mut row = vec![
        format!("team ({} of {} merged)", team.merged_robots, summary.robots.len()),
        summary.robots.iter().map(|robot| robot.keyframes).sum::<usize>().to_string(),
        team.closures.proposed.to_string(),
        team.closures.accepted.to_string(),
        team.closures.true_accepted.map_or_else(unknown, |count| count.to_string()),
        unknown(),
        metres(team.ate_m),
        kbit(team.sent_bits),
    ];
    row.extend(kinds.iter().map(of_kind));
    row
}

fn footer(summary: &Summary) -> String {
    let share = |value: Option<f64>| value.map_or_else(unknown, |value| format!("{:.1} %", 100.0 * value));
    let team = &summary.team;
    format!(
        "closures between robots: precision {}, recall {}; {} kbit an accepted closure\n",
        share(team.precision),
        share(team.recall),
        team.bits_per_accepted_closure.map_or_else(unknown, |bits| format!("{:.2}", bits / 1000.0)),
    )
}

fn unknown() -> String {
    "-".to_owned()
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(unknown, |value| format!("{value:.2} m"))
}

fn kbit(bits: u64) -> String {
    format!("{:.1}", bits as f64 / 1000.0)
}

/// Columns as wide as their widest cell: the first flush left, numbers flush right.
fn layout(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column| {
        rows.iter()
            .filter_map(|row| row.get(column))
            .map(|cell: &String| cell.chars().count())
            .max()
            .unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            text += &if column == 0 { format!("{cell:<width$}") } else { format!("  {cell:>width$}") };
        }
        text.push('\n');
    }
    text
}
