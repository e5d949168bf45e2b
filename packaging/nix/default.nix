# nix-build packaging/nix
{ pkgs ? import <nixpkgs> { } }:

pkgs.rustPlatform.buildRustPackage {
  pname = "granita";
  version = "0.1.0";
  src = pkgs.lib.cleanSource ../..;
  cargoLock.lockFile = ../../Cargo.lock;
  cargoBuildFlags = [ "--package" "granita" ];
  # The tests need the whole workspace and its examples: run them in a checkout.
  doCheck = false;
  nativeBuildInputs = [ pkgs.makeWrapper ];
  postInstall = ''
    for tool in gelato maketx oiio-maketx gslc gsoinfo topyg imgtool iv; do
      ln -s granita "$out/bin/$tool"
    done
    "$out/bin/granita" -share "$out/share"
  '';
  # What the window of iv loads while it runs.
  postFixup = ''
    wrapProgram "$out/bin/granita" --suffix LD_LIBRARY_PATH : ${
      pkgs.lib.makeLibraryPath (with pkgs; [ libGL libxkbcommon vulkan-loader xorg.libX11 xorg.libXcursor xorg.libXi ])
    }
  '';
}
