"""Parts of the Granita suite as Python modules.

``granita.texture`` looks up textures. The renderer is the package ``gelato``.
"""
