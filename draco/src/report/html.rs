use std::fmt::Write;

use super::svg::escape;
use super::{RobotReport, RunReport, Summary};
use crate::evaluate::Decision;

impl RunReport {
    /// The run as one HTML page that needs no network: map, errors, closures, traffic, tables.
    pub fn html(&self) -> String {
        let summary = self.summary();
        let title = format!("{} · {}", escape(&self.scenario), escape(&self.consistency));
        let mut page = format!(
            "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
             content=\"width=device-width,initial-scale=1\"><title>{title}</title><style>{}{}{}</style></head>\
             <body><main>",
            include_str!("colors.css"),
            include_str!("map.css"),
            include_str!("page.css"),
        );
        page += &self.headline(&summary);
        page += &self.map_figure();
        page += &self.robot_table(&summary);
        page += &self.error_figures();
        page += "<div class=\"pair\">";
        page += &self.closure_figure();
        page += &self.traffic_figure(&summary);
        page += "</div>";
        page += &self.object_figures();
        page += &self.alignments();
        page += &self.details(&summary);
        let _ = writeln!(page, "</main><script>{}</script></body></html>", include_str!("page.js"));
        page
    }

    fn headline(&self, summary: &Summary) -> String {
        let team = &summary.team;
        let robots = summary.robots.len();
        let keyframes: usize = summary.robots.iter().map(|robot| robot.keyframes).sum();
        let mut html = format!(
            "<header><h1>{}</h1><p>{robots} robots, {keyframes} keyframes, consistency <b>{}</b>, seed {}</p>\
             <dl class=\"tiles\">",
            escape(&self.scenario),
            escape(&self.consistency),
            self.seed,
        );
        let tiles = [
            ("team error", metres(team.ate_m), "position RMSE, one alignment".to_owned()),
            ("in one frame", format!("{} / {robots}", team.merged_robots), "robots".to_owned()),
            ("precision", share(team.precision), "accepted closures that are right".to_owned()),
            ("recall", share(team.recall), "right closures that were accepted".to_owned()),
            ("sent", kbit(team.sent_bits), self.link_note()),
        ];
        for (name, value, note) in tiles {
            let _ = write!(html, "<div><dt>{name}</dt><dd>{value}</dd><small>{note}</small></div>");
        }
        html + "</dl></header>"
    }

    fn link_note(&self) -> String {
        match self.link_bits_per_second {
            Some(rate) => format!("kbit over a link of {:.1} kbit/s", rate / 1000.0),
            None => "kbit".to_owned(),
        }
    }

    fn map_figure(&self) -> String {
        let mut legend = String::new();
        for robot in self.drawn() {
            let (color, id) = (self.color_of(robot.id), robot.id);
            let _ = write!(
                legend,
                "<label class=\"c{color}\"><input type=\"checkbox\" checked data-hide=\".r{id}\"><i></i>robot {id}\
                 </label>"
            );
        }
        let has_truth = self.drawn().any(|robot| robot.truth.iter().any(Option::is_some));
        let parts = [
            (".points", "points", "dot", true),
            (".truth", "truth", "dash", has_truth),
            (".accepted", "accepted closures", "good", true),
            (".wrong", "accepted, wrong", "bad", has_truth),
            (".rejected,.undecided", "rejected, undecided", "soft", true),
        ];
        for (selector, name, class, _) in parts.into_iter().filter(|(.., shown)| *shown) {
            let _ = write!(
                legend,
                "<label><input type=\"checkbox\" checked data-hide=\"{selector}\"><i class=\"{class}\"></i>{name}\
                 </label>"
            );
        }
        let last = self.drawn().map(|robot| robot.trajectory.len()).max().unwrap_or(1).saturating_sub(1);
        let left_out: Vec<_> = self
            .robots
            .iter()
            .filter(|robot| self.drawn().all(|drawn| drawn.id != robot.id))
            .map(|robot| robot.id.to_string())
            .collect();
        let note = match left_out.len() {
            0 => String::new(),
            _ => format!(
                "<p class=\"note\">Not in the common frame, so not drawn: robot {}.</p>",
                left_out.join(", ")
            ),
        };
        format!(
            "<figure id=\"map\"><div class=\"legend\">{legend}</div>{}<label class=\"time\">mission up to keyframe \
             <input type=\"range\" id=\"until\" min=\"0\" max=\"{last}\" value=\"{last}\"><output>{last}</output>\
             </label>{note}</figure>",
            self.map("", "")
        )
    }

    fn robot_table(&self, summary: &Summary) -> String {
        let mut html = "<section><h2>Robots</h2><div class=\"scroll\"><table id=\"robots\"><thead><tr><th>robot\
            <th>keyframes<th>path<th>proposed<th>accepted<th>true<th>dead reckoning<th>local SLAM<th>final<th>sent\
            </thead><tbody>"
            .to_owned();
        for robot in &summary.robots {
            let alone = if robot.merged { "" } else { " <em>alone</em>" };
            let _ = write!(
                html,
                "<tr>{}{alone}<td>{}<td>{:.0} m<td>{}<td>{}<td>{}<td>{}<td>{}<td><b>{}</b><td>{}",
                self.row_head(robot.id),
                robot.keyframes,
                robot.path_m,
                robot.closures.proposed,
                robot.closures.accepted,
                count(robot.closures.true_accepted),
                metres(robot.ate_dead_reckoning_m),
                metres(robot.ate_local_m),
                metres(robot.ate_m),
                kbit(robot.sent_bits.values().sum()),
            );
        }
        let team = &summary.team;
        let _ = write!(
            html,
            "</tbody><tfoot><tr><th>team<td>{}<td><td>{}<td>{}<td>{}<td><td><td><b>{}</b><td>{}",
            summary.robots.iter().map(|robot| robot.keyframes).sum::<usize>(),
            team.closures.proposed,
            team.closures.accepted,
            count(team.closures.true_accepted),
            metres(team.ate_m),
            kbit(team.sent_bits),
        );
        html + "</tfoot></table></div><p class=\"note\">Errors are position RMSE after one rigid alignment; traffic is in \
                kbit, headers included.</p></section>"
    }

    fn row_head(&self, robot: crate::keyframe::RobotId) -> String {
        format!("<th class=\"c{}\"><i></i>{robot}", self.color_of(robot))
    }

    /// What each robot sent by type of message, kbit.
    fn traffic_table(&self, summary: &Summary) -> String {
        let kinds = self.message_kinds();
        let mut html = "<div class=\"scroll\"><table id=\"sent\"><thead><tr><th>kbit".to_owned();
        for kind in &kinds {
            let _ = write!(html, "<th>{}", escape(kind));
        }
        html += "</thead><tbody>";
        for robot in &summary.robots {
            html += "<tr>";
            html += &self.row_head(robot.id);
            for kind in &kinds {
                let _ = write!(html, "<td>{}", kbit(robot.sent_bits.get(kind).copied().unwrap_or(0)));
            }
        }
        html += "</tbody><tfoot><tr><th>team";
        for kind in &kinds {
            let sent: u64 = summary.robots.iter().filter_map(|robot| robot.sent_bits.get(kind)).sum();
            let _ = write!(html, "<td>{}", kbit(sent));
        }
        html + "</tfoot></table></div>"
    }

    fn error_figures(&self) -> String {
        let figure = |robot: &RobotReport| {
            let chart = self.error_chart(robot);
            let color = self.color_of(robot.id);
            let caption = format!("<figcaption class=\"c{color}\"><i></i>robot {}</figcaption>", robot.id);
            if chart.is_empty() { chart } else { format!("<figure>{caption}{chart}</figure>") }
        };
        let charts: String = self.robots.iter().map(figure).collect();
        if charts.is_empty() {
            return charts;
        }
        format!(
            "<section><h2>Distance from the truth, metres</h2><p class=\"note\">Grey: dead reckoning. Colour: final \
             estimate. Each under its own best alignment.</p><div class=\"charts\">{charts}</div></section>"
        )
    }

    fn closure_figure(&self) -> String {
        let rows = self.reasons();
        let most = rows.iter().map(|(_, _, counts)| counts.iter().sum::<usize>()).max().unwrap_or(1);
        let mut html = "<section><h2>Closures between robots, by verdict and reason</h2>".to_owned();
        if rows.is_empty() {
            return html + "<p class=\"note\">None was proposed.</p></section>";
        }
        html += "<table class=\"bars\" id=\"closures\">";
        for (decision, reason, counts) in rows {
            let class = decision.as_str();
            let _ =
                write!(html, "<tr class=\"{class}\"><th>{class}<td>{}<td>", reason_text(decision, &reason));
            for (name, count) in ["right", "wrong", "unknown"].into_iter().zip(counts) {
                if count > 0 {
                    let width = 100.0 * count as f64 / most as f64;
                    let _ = write!(
                        html,
                        "<span class=\"bar {name}\" style=\"width:{width:.1}%\" title=\"{count} {name}\">{count}</span>"
                    );
                }
            }
        }
        html + "</table><p class=\"note key\"><span class=\"bar right\"></span>right by the truth \
                <span class=\"bar wrong\"></span>wrong <span class=\"bar unknown\"></span>no truth</p></section>"
    }

    fn traffic_figure(&self, summary: &Summary) -> String {
        let chart = self.traffic_chart();
        let mut html = "<section><h2>Traffic over time, kbit/s</h2>".to_owned();
        if chart.is_empty() {
            return html + "<p class=\"note\">Nothing was sent.</p></section>";
        }
        html += &chart;
        html += "<p class=\"note key\">";
        for (index, kind) in self.message_kinds().iter().enumerate() {
            let _ = write!(html, "<span><i class=\"k{index}\"></i>{}</span> ", escape(kind));
        }
        html += "</p>";
        html += &self.traffic_table(summary);
        html += "<p class=\"note\">";
        if let Some(bits) = summary.team.bits_per_accepted_closure {
            let _ = write!(html, "{:.2} kbit for each accepted closure. ", bits / 1000.0);
        }
        html + "</p></section>"
    }

    fn alignments(&self) -> String {
        let mut rows = String::new();
        for robot in &self.robots {
            for matched in &robot.matched {
                let _ = write!(
                    rows,
                    "<tr><td>{:.0} s<th class=\"c{}\"><i></i>{}<th class=\"c{}\"><i></i>{}<td>{}",
                    matched.time,
                    self.color_of(robot.id),
                    robot.id,
                    self.color_of(matched.partner),
                    matched.partner,
                    escape(&matched.verdict),
                );
            }
        }
        if rows.is_empty() {
            return rows;
        }
        format!(
            "<section><details><summary>How maps were matched</summary><div class=\"scroll\"><table class=\"text\">\
             <thead><tr><th>time<th>robot<th>partner<th>verdict</thead><tbody>{rows}</tbody></table></div></details>\
             </section>"
        )
    }

    fn details(&self, summary: &Summary) -> String {
        let mut rows = String::new();
        for (name, value) in &summary.settings {
            let _ = write!(rows, "<tr><th>{}<td>{}", escape(name), escape(value));
        }
        for (name, seconds) in &summary.timing {
            let _ = write!(rows, "<tr><th>time: {}<td>{seconds:.3} s", escape(name));
        }
        let team = &summary.team;
        let _ = write!(rows, "<tr><th>precision within 0.5 m and 2°<td>{}", share(team.precision_strict));
        let nees = team.closure_nees.map_or_else(unknown, |value| format!("{value:.2}"));
        let _ = write!(rows, "<tr><th>normalised error² of accepted closures (1 is honest)<td>{nees}");
        format!(
            "<section><details><summary>Settings and figures</summary><table class=\"text\">{rows}</table></details>\
             </section>"
        )
    }
}

fn reason_text(decision: Decision, reason: &str) -> String {
    if decision == Decision::Accepted && reason.is_empty() { "–".to_owned() } else { escape(reason) }
}

fn unknown() -> String {
    "–".to_owned()
}

fn count(value: Option<usize>) -> String {
    value.map_or_else(unknown, |value| value.to_string())
}

fn metres(value: Option<f64>) -> String {
    value.map_or_else(unknown, |value| format!("{value:.2} m"))
}

fn share(value: Option<f64>) -> String {
    value.map_or_else(unknown, |value| format!("{:.1} %", 100.0 * value))
}

fn kbit(bits: u64) -> String {
    format!("{:.1}", bits as f64 / 1000.0)
}
