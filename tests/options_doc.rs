//! `docs/options.md` says what the program's options say.

#[test]
fn the_options_page_is_the_one_that_the_program_prints() {
    let page = std::fs::read_to_string("docs/options.md").unwrap_or_default();
    let printed = drystone::cli::options_markdown();
    assert!(page == printed, "docs/options.md is stale: cargo run -- options-markdown > docs/options.md");
}

#[test]
fn every_exit_code_is_on_the_page() {
    let page = drystone::cli::options_markdown();
    for code in 0..=8 {
        assert!(page.contains(&format!("\n| {code} | ")), "{code}");
    }
}
