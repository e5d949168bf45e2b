//! Compiles the shim between C++ classes and C tables.

fn main() {
    let headers = "../../bindings/cpp/include";
    println!("cargo:rerun-if-changed=cpp/shim.cpp");
    println!("cargo:rerun-if-changed={headers}");
    cc::Build::new()
        .cpp(true)
        .std("c++11")
        .include(headers)
        .file("cpp/shim.cpp")
        .flag_if_supported("-Wno-unused-parameter")
        .compile("gelato_shim");
}
