# A formula for a tap of your own. `url` is the place of a checkout.
class GranitaSuite < Formula
  desc "Suite for images and light: renderer, textures, shaders, viewer"
  homepage "https://localhost/granita"
  url "file:///path/to/granita", using: :git, branch: "main"
  version "0.1.0"
  license any_of: ["MIT", "Apache-2.0"]

  depends_on "rust" => :build

  def install
    system "cargo", "xtask", "install", "--prefix", libexec
    # maketx and iv are those of openimageio: "granita maketx", "granita iv".
    %w[granita gelato gslc gsoinfo imgtool oiio-maketx topyg].each { |name| bin.install_symlink libexec/"bin"/name }
    man1.install_symlink Dir[libexec/"share/man/man1/*"].reject { |page| page.end_with?("/maketx.1", "/iv.1") }
    %w[granita gelato gslc gsoinfo topyg].each do |name|
      bash_completion.install_symlink libexec/"share/bash-completion/completions"/name
      zsh_completion.install_symlink libexec/"share/zsh/site-functions/_#{name}"
      fish_completion.install_symlink libexec/"share/fish/vendor_completions.d/#{name}.fish"
    end
  end

  test do
    (testpath/"a.pyg").write <<~PYG
      Output ("a.tif", "tiff", "rgba", "camera")
      World ()
      Sphere (1, -1, 1, 360)
      Render ()
    PYG
    system bin/"gelato", "-silent", "a.pyg"
    assert_path_exists testpath/"a.tif"
  end
end
