//! `report` as a process, and its page as a person meets it: in a browser, if there is one.
//!
//! The browser is Chromium (`$CHROMIUM`, else `chromium` on the path; Debian: `apt-get install chromium`). Without it the
//! tests that need one say `skipped`.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;
use std::process::Command;

use common::bench::{Bench, files_below};
use serde_json::{Value, json};

/// A finished run with figures and tables; the policy's name is unkind to web pages.
fn finished_run(bench: &Bench) -> String {
    let record = |x: f64| json!({"avg_solved_step_frac": x, "max_episode_steps": 100, "num_episodes": 4, "std_solved_steps": 1.0});
    let records = |x: f64, y: f64, z: f64| {
        json!({"pen": record(x), "reorient": record(y), "elbow_pose": record(z)}).to_string()
    };
    bench.write("tree/expert_policies/expert_a_results.json", records(0.5, 0.6, 0.25).as_bytes());
    bench.write("tree/arnold/seed_0/a_results.json", records(0.4, 0.7, 0.3).as_bytes());
    let name = "<script>alert(1)<!--\"'&";
    bench.write("mine.json", records(0.1, 0.2, 0.3).as_bytes());
    let named = format!("{name}=mine.json");
    let words = ["evaluate", "--benchmarks", "tree", &named, "--json"];
    bench.json(&words)["folder"].as_str().unwrap().to_owned()
}

/// Puts other content into a file of a run.
fn write(run: &str, name: &str, content: &str) {
    arnold_analyze::files::write_atomic(&Path::new(run).join(name), content.as_bytes()).unwrap();
}

fn page(bench: &Bench, words: &[&str]) -> String {
    let ended = bench.run(&[&["report"], words].concat());
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    std::fs::read_to_string(bench.path("report.html")).unwrap()
}

#[test]
fn the_page_holds_figures_tables_and_the_command_and_asks_nobody_for_anything() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    let html = page(&bench, &[&run]);
    let count = |kind: &str| {
        let names = files_below(Path::new(&run)).into_keys();
        names.filter(|name| name.rsplit('.').next() == Some(kind)).count()
    };
    let figures = count("svg");
    assert_eq!(html.matches("<svg").count(), figures);
    let tables = count("parquet");
    assert_eq!(html.matches("<table>").count(), tables + 1, "and that of the files");
    for said in
        ["evaluate --benchmarks tree", "SHA-256", "prefers-color-scheme", "data-value=", "Manifest"]
    {
        assert!(html.contains(said), "{said}");
    }
    // Our own script, and no other; no address but the name of nothing.
    assert_eq!(html.matches("<script").count(), 1);
    assert!(html.contains("&lt;script&gt;alert(1)&lt;!--&quot;&#39;&amp;"));
    for request in
        ["http://", "https://", "src=", "@import", "url(http", "<link", "<img", "<iframe"]
    {
        assert!(!html.contains(request), "{request}");
    }
    // Identifiers of several drawings do not meet.
    let ids: Vec<&str> =
        html.split(" id=\"").skip(1).map(|rest| &rest[..rest.find('"').unwrap()]).collect();
    let distinct: std::collections::BTreeSet<&&str> = ids.iter().collect();
    assert_eq!(distinct.len(), ids.len());
}

#[test]
fn the_same_runs_give_the_same_page_and_several_stand_on_one() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    let one = page(&bench, &[&run]);
    assert!(page(&bench, &[&run]) == one);
    let two = page(&bench, &[&run, &run]);
    assert!(two.contains("<nav>") && two.contains("id=\"run2\"") && !one.contains("<nav>"));
}

#[test]
fn what_is_no_run_or_was_changed_is_named() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    let ended = bench.run(&["report", "nothing"]);
    assert!(ended.code == 1 && ended.stderr.contains("`nothing`"), "{}", ended.stderr);
    assert!(ended.stderr.contains("hint: "), "{}", ended.stderr);
    write(&run, "radar.svg", "<svg onload=\"alert(1)\"/>");
    std::fs::remove_file(Path::new(&run).join("seeds.parquet")).unwrap();
    let ended = bench.run(&["report", &run, "--out", "pages/a.html"]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("radar.svg`: it was changed"), "{}", ended.stderr);
    assert!(ended.stderr.contains("seeds.parquet`: it is not there"), "{}", ended.stderr);
    let html = std::fs::read_to_string(bench.path("pages/a.html")).unwrap();
    assert!(html.contains("Not shown") && !html.contains("onload"));
}

#[test]
fn a_drawing_that_is_none_of_ours_is_refused_even_if_the_manifest_vouches_for_it() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    let manifest = Path::new(&run).join("manifest.json");
    let mut document: Value = serde_json::from_slice(&std::fs::read(&manifest).unwrap()).unwrap();
    let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script></svg>";
    write(&run, "radar.svg", svg);
    for file in document["files"].as_array_mut().unwrap() {
        if file["name"] == "radar.svg" {
            file["sha256"] = arnold_analyze::files::sha256_hex(svg.as_bytes()).into();
        }
    }
    write(&run, "manifest.json", &document.to_string());
    let ended = bench.run(&["report", &run]);
    assert!(
        ended.code == 1 && ended.stderr.contains("no `script` in our drawings"),
        "{}",
        ended.stderr
    );
    assert!(!bench.path("report.html").exists());
}

/// Chromium with `arguments`, its profile in the bench; `None` if there is no such browser.
fn browser(bench: &Bench, arguments: &[&str]) -> Option<std::process::Output> {
    let program = std::env::var("CHROMIUM").unwrap_or_else(|_| "chromium".to_owned());
    let profile = format!("--user-data-dir={}", bench.path("profile").display());
    let output = Command::new(program)
        .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", &profile])
        .args(arguments)
        .output();
    if output.is_err() {
        eprintln!("skipped: there is no `chromium`");
    }
    output.ok()
}

#[test]
fn in_a_browser_the_tables_sort_both_ways_and_nothing_else_runs() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    let html = page(&bench, &[&run]);
    // What a reader would do, typed at the end of a copy of the page.
    let click = "<script>\
        const table = document.querySelector('table');\
        const button = [...table.querySelectorAll('th button')].find((b) => b.textContent.startsWith('solved_fraction'));\
        const column = () => [...table.tBodies[0].rows].map((r) => r.cells[button.closest('th').cellIndex].dataset.value).join(' ');\
        const said = [];\
        button.click(); said.push(column(), button.closest('th').ariaSort);\
        button.click(); said.push(column(), button.closest('th').ariaSort);\
        said.push(document.querySelectorAll('figure svg').length);\
        document.title = said.join('; ');</script></body>";
    bench.write("copy.html", html.replace("</body>", click).as_bytes());
    let address = format!("file://{}", bench.path("copy.html").display());
    let Some(output) = browser(&bench, &["--dump-dom", &address]) else { return };
    let dom = String::from_utf8_lossy(&output.stdout);
    let title = dom.split("<title>").nth(1).and_then(|rest| rest.split("</title>").next());
    let figures = html.matches("<svg").count();
    let want = format!("0.25 0.5 0.6; ascending; 0.6 0.5 0.25; descending; {figures}");
    assert_eq!(title, Some(want.as_str()), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn in_a_browser_the_page_is_drawn_light_and_dark() {
    let bench = Bench::new();
    let run = finished_run(&bench);
    page(&bench, &[&run]);
    let address = format!("file://{}", bench.path("report.html").display());
    let picture = |name: &str, scheme: &str| -> Option<Vec<u8>> {
        let path = bench.path(name);
        let shot = format!("--screenshot={}", path.display());
        let scheme = format!("--blink-settings=preferredColorScheme={scheme}");
        browser(&bench, &["--window-size=1000,1400", &scheme, &shot, &address])?;
        Some(std::fs::read(path).unwrap())
    };
    let (Some(dark), Some(light)) = (picture("dark.png", "0"), picture("light.png", "1")) else {
        return;
    };
    // A blank page of this size takes a few kilobytes.
    assert!(light.len() > 30_000 && dark.len() > 30_000, "{} {}", light.len(), dark.len());
    assert_ne!(light, dark);
}
