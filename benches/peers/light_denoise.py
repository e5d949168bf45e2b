"""Removes the noise of images with Open Image Denoise 1.4 or 2, for programs that have no calls of it."""

import ctypes

import numpy as np

FLOAT3 = 3
CPU = 1


class Denoiser:
    def __init__(self, library, threads):
        """Loads the library, whose file is given."""
        self.lib = lib = ctypes.CDLL(library)
        for name in ("oidnNewDevice", "oidnNewFilter"):
            getattr(lib, name).restype = ctypes.c_void_p
        lib.oidnGetDeviceError.restype = ctypes.c_int
        # Version 2 has other names of the calls that set a number.
        self.integer = getattr(lib, "oidnSetDeviceInt", None) or lib.oidnSetDevice1i
        self.truth = getattr(lib, "oidnSetFilterBool", None) or lib.oidnSetFilter1b
        self.device = ctypes.c_void_p(lib.oidnNewDevice(CPU))
        self.integer(self.device, b"numThreads", ctypes.c_int(threads))
        lib.oidnCommitDevice(self.device)

    def __call__(self, color, albedo, normal):
        """Returns an image without its noise. All images have the shape (height, width, 3)."""
        arrays = {name: np.ascontiguousarray(image, np.float32)
                  for name, image in (("color", color), ("albedo", albedo), ("normal", normal), ("output", np.zeros_like(color)))}
        height, width, _ = color.shape
        filter = ctypes.c_void_p(self.lib.oidnNewFilter(self.device, b"RT"))
        for name, array in arrays.items():
            pointer, sizes = ctypes.c_void_p(array.ctypes.data), [ctypes.c_size_t(n) for n in (width, height, 0, 0, 0)]
            self.lib.oidnSetSharedFilterImage(filter, name.encode(), pointer, ctypes.c_int(FLOAT3), *sizes)
        self.truth(filter, b"hdr", ctypes.c_bool(True))
        self.lib.oidnCommitFilter(filter)
        self.lib.oidnExecuteFilter(filter)
        message = ctypes.c_char_p()
        if self.lib.oidnGetDeviceError(self.device, ctypes.byref(message)):
            raise RuntimeError(message.value)
        self.lib.oidnReleaseFilter(filter)
        return arrays["output"]
