// The symbols that a shared library exports. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GELATO_EXPORT_H
#define GELATO_EXPORT_H

// GELATO_EXPORT precedes the exported symbols of a plugin. GELATO_PUBLIC marks the classes of these headers.
#if defined(_WIN32)
#define GELATO_EXPORT __declspec(dllexport)
#define GELATO_PUBLIC
#elif defined(__GNUC__)
#define GELATO_EXPORT __attribute__((visibility("default")))
#define GELATO_PUBLIC __attribute__((visibility("default")))
#else
#define GELATO_EXPORT
#define GELATO_PUBLIC
#endif

// The names that older sources use for GELATO_EXPORT.
#ifndef DLLEXPORT
#define DLLEXPORT GELATO_EXPORT
#endif
#ifndef EXPORT
#define EXPORT GELATO_EXPORT
#endif

#endif
