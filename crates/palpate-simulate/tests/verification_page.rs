//! The page of verification speaks of tests that exist.

#[test]
fn it_names_tests_that_exist() {
    let page = include_str!("../../../docs/verification.md");
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut code = include_str!("../src/element/tests.rs").to_string();
    for file in files.filter(|path| path.extension().is_some_and(|e| e == "rs")) {
        code += &std::fs::read_to_string(file).unwrap();
    }
    // The table's last column: `file`: `test`, or inside: `test`.
    let rows = page
        .lines()
        .filter(|line| line.starts_with("| ") && line.contains("`: `") || line.contains("inside: `"));
    let mut named = 0;
    for row in rows {
        let Some((_, test)) = row.rsplit_once(": `") else { continue };
        let test = test.split('`').next().unwrap();
        assert!(
            code.contains(&format!("fn {test}()")),
            "docs/verification.md names the test {test}, which is not there"
        );
        named += 1;
    }
    assert!(named > 15, "{named} tests found in the table");
}
