//! The report opens in a browser without a network: the map is there, its slider works, nothing fails.

use std::path::Path;
use std::process::Command;

use draco::mission::{MissionParams, run};
use draco::report::write_run;
use draco::simulate::{SimulationParams, simulate};

/// Runs Chromium on a page with `arguments`; what it prints.
fn chromium(profile: &Path, page: &Path, arguments: &[&str]) -> String {
    let output = Command::new("chromium")
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--window-size=1280,1600",
            "--virtual-time-budget=3000",
        ])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(arguments)
        .arg(format!("file://{}", page.display()))
        .output()
        .expect("chromium starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn the_report_opens_in_a_browser() {
    if Command::new("chromium").arg("--version").output().is_err() {
        assert!(std::env::var_os("DRACO_REQUIRE_BROWSER").is_none(), "there is no chromium");
        println!("skipped: there is no chromium");
        return;
    }
    let params = SimulationParams { keyframes: Some(6), ..SimulationParams::default() };
    let data = simulate(&params).expect("defaults are valid");
    let report = run(&data, &MissionParams::default(), |_| {}).expect("the mission runs");
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().join("out");
    write_run(&report, &out).expect("writable");
    let page = out.join("report.html");
    let profile = folder.path().join("profile");

    let dom = chromium(&profile, &page, &["--dump-dom"]);
    assert!(dom.contains("data-ready=\"yes\""), "the page's script did not run to its end");
    assert!(
        dom.contains("<svg") && dom.contains("id=\"map\"") && dom.contains("<table"),
        "no map or no table"
    );
    assert!(
        !dom.contains("http://")
            || dom.matches("http://").count() == dom.matches("http://www.w3.org").count()
    );

    let shot = folder.path().join("report.png");
    chromium(&profile, &page, &[&format!("--screenshot={}", shot.display())]);
    let png = std::fs::read(&shot).expect("a screenshot");
    assert!(png.starts_with(b"\x89PNG") && png.len() > 20_000, "{} bytes", png.len());

    // what the slider does: at the first keyframe only the first keyframe is shown
    let html = std::fs::read_to_string(&page).expect("written");
    let moved = html.replace(
        "</body>",
        "<script>slider.value = 0; slider.dispatchEvent(new Event('input'));\
         document.body.dataset.shown = [...map.querySelectorAll('[data-k]:not(.off)')]\
         .every((part) => part.dataset.k === '0');</script></body>",
    );
    std::fs::write(&page, moved).expect("writable");
    let dom = chromium(&profile, &page, &["--dump-dom"]);
    assert!(dom.contains("data-shown=\"true\""), "the slider hides nothing");
}
