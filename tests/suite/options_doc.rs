//! `docs/reference/options.md` says what the program's options say.

#[test]
fn the_options_page_is_the_one_that_the_program_prints() {
    let page = std::fs::read_to_string("docs/reference/options.md").unwrap_or_default();
    let printed = drystone::cli::options_markdown();
    assert!(
        page == printed,
        "docs/reference/options.md is stale: cargo run -- options-markdown > docs/reference/options.md"
    );
}

#[test]
fn every_exit_code_is_on_the_page() {
    let page = drystone::cli::options_markdown();
    for code in 0..=8 {
        assert!(page.contains(&format!("\n| {code} | ")), "{code}");
    }
}

#[test]
fn every_setting_of_a_metric_and_of_the_reconstruction_is_on_the_page_about_choosing() {
    use drystone::cost::{classic, curvature, oblique, sharpness, terrain};
    let page = std::fs::read_to_string("docs/guide/choosing.md").unwrap();
    let metrics: [&[_]; 5] = [
        &classic::PARAMETERS,
        &oblique::PARAMETERS,
        &curvature::PARAMETERS,
        &terrain::PARAMETERS,
        &sharpness::PARAMETERS,
    ];
    let remesh: &[_] = &drystone::remesh::cvd::PARAMETERS;
    for (parameters, first) in [(metrics.concat(), "| `qem-1997` | `border`"), (remesh.to_vec(), "| `lambda` |")] {
        let mut lines = page.lines().skip_while(|line| !line.starts_with(first));
        for parameter in parameters {
            let line = lines.next().unwrap_or_default();
            assert!(
                line.contains(&format!("| `{}` | {} |", parameter.name, parameter.default_text())),
                "{}: {line}",
                parameter.name
            );
        }
    }
}

#[test]
fn every_number_of_the_format_on_the_page_about_files_is_the_one_that_is_written() {
    let page = std::fs::read_to_string("docs/reference/work-folder.md").unwrap();
    for words in ["This page describes format ", "version of the format: "] {
        let numbers = page.split(words).skip(1).map(|rest| rest.split(|c: char| !c.is_ascii_digit()).next().unwrap());
        let numbers: Vec<_> = numbers.collect();
        assert!(!numbers.is_empty(), "{words}");
        assert!(
            numbers.iter().all(|number| *number == drystone::file::FORMAT_VERSION.to_string()),
            "{words}{numbers:?}"
        );
    }
}
