// Types of parameters and attributes. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GELATO_PARAMTYPE_H
#define GELATO_PARAMTYPE_H

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifndef NULL
#define NULL 0
#endif

#include "export.h"

namespace Gelato {

// The base type of a value.
enum ParamBaseType {
    PT_UNKNOWN = 0,
    PT_VOID,
    PT_STRING,
    PT_FLOAT, PT_HALF, PT_DOUBLE,
    PT_POINT, PT_VECTOR, PT_NORMAL,
    PT_COLOR,
    PT_HPOINT, PT_MATRIX,
    PT_INT8, PT_UINT8, PT_INT16, PT_UINT16, PT_INT, PT_UINT,
    PT_POINTER,
    PT_LAST
};

// Returns the word for a type, such as "float"; "unknown" for an invalid number.
inline const char *ParamBaseTypeNameString (int t)
{
    static const char *const names[PT_LAST] = {
        "unknown", "void", "string", "float", "half", "double", "point", "vector", "normal", "color",
        "hpoint", "matrix", "int8", "uint8", "int16", "uint16", "int", "uint", "pointer"
    };
    return t >= 0 && t < PT_LAST ? names[t] : names[0];
}

// Returns the number of bytes of one value.
inline int ParamBaseTypeSize (int t)
{
    switch (t) {
    case PT_STRING: return sizeof(char *);
    case PT_FLOAT: return sizeof(float);
    case PT_HALF: return 2;
    case PT_DOUBLE: return sizeof(double);
    case PT_POINT: case PT_VECTOR: case PT_NORMAL: case PT_COLOR: return 3 * sizeof(float);
    case PT_HPOINT: return 4 * sizeof(float);
    case PT_MATRIX: return 16 * sizeof(float);
    case PT_INT8: case PT_UINT8: return 1;
    case PT_INT16: case PT_UINT16: return 2;
    case PT_INT: case PT_UINT: return sizeof(int);
    case PT_POINTER: return sizeof(void *);
    default: return 0;
    }
}

// Returns the number of floats of one value; 0 for types that do not consist of floats.
inline int ParamBaseTypeNFloats (int t)
{
    switch (t) {
    case PT_FLOAT: return 1;
    case PT_POINT: case PT_VECTOR: case PT_NORMAL: case PT_COLOR: return 3;
    case PT_HPOINT: return 4;
    case PT_MATRIX: return 16;
    default: return 0;
    }
}

// The interpolation of values over a primitive.
enum ParamInterp {
    INTERP_CONSTANT = 0,  // one value for the whole primitive
    INTERP_PERPIECE = 1,  // one value for each face or curve
    INTERP_LINEAR = 2,    // one value for each corner, interpolated linearly
    INTERP_VERTEX = 3     // one value for each control vertex, interpolated as positions are
};

// A type: base, length of an array, interpolation. It has the size of an int.
class GELATO_PUBLIC ParamType {
public:
    // Makes a type that is not initialised.
    ParamType (void) {}

    // Makes the type of a single value.
    ParamType (ParamBaseType base, ParamInterp detail=INTERP_CONSTANT) {
        basetype = base;
        arraylen = 1;
        isarray = 0;
        interp = detail;
        reserved = 0;
    }

    // Makes the type of an array, or of a single value when the length is 0.
    ParamType (ParamBaseType base, short array, ParamInterp det=INTERP_CONSTANT) {
        basetype = base;
        arraylen = array;
        isarray = (array != 0);
        if (! isarray)
            arraylen = 1;
        interp = det;
        reserved = 0;
    }

    // Makes the type of words such as "vertex float[3]". The base is PT_UNKNOWN when they do not name a type.
    ParamType (const char *typestring) {
        basetype = PT_UNKNOWN;
        arraylen = 1;
        isarray = 0;
        interp = INTERP_CONSTANT;
        reserved = 0;
        fromstring (typestring);
    }

    // Reads the type at the beginning of a string. Returns the length of that part. Without a type it returns 0, and
    // the object does not change. The rest of the string is copied to `shortname`, if that is not NULL.
    int fromstring (const char *typestring, char *shortname=NULL);

    // Writes the words for the type. Returns true when the type is valid and the words fit into `maxlen` bytes.
    bool tostring (char *typestring, int maxlen, bool showinterp=false) const;

    // Returns the number of bytes of one value of this type, with all elements of an array.
    int datasize (void) const { return arraylen*ParamBaseTypeSize(basetype); }

    int nfloats (void) const { return arraylen*ParamBaseTypeNFloats(basetype); }

    bool operator== (const ParamType &t) const {
        return basetype == t.basetype && arraylen == t.arraylen && isarray == t.isarray
            && interp == t.interp && reserved == t.reserved;
    }

    // Makes this the type of a single value.
    void unarray (void) { isarray = false; arraylen = 1; }

    unsigned int basetype:5;  // a ParamBaseType
    unsigned int arraylen:18; // 1 when it is not an array
    unsigned int isarray:1;
    unsigned int interp:3;    // a ParamInterp
    unsigned int reserved:5;
};

inline int ParamType::fromstring (const char *typestring, char *shortname)
{
    static const char *const interps[4] = { "constant", "perpiece", "linear", "vertex" };
    const char *blanks = " \t\n\r";
    const char *s = typestring;
    int base = PT_UNKNOWN, detail = INTERP_CONSTANT;
    if (! s)
        return 0;
    // Reads words up to the one that names a base type.
    while (base == PT_UNKNOWN) {
        s += strspn (s, blanks);
        size_t length = strcspn (s, " \t\n\r[");
        if (length == 0)
            return 0;
        int found = -1;
        for (int i = 0; i < 4; ++i)
            if (strlen (interps[i]) == length && ! strncmp (s, interps[i], length))
                found = i;
        if (found >= 0) {
            detail = found;
        } else {
            for (int i = PT_VOID; i < PT_LAST; ++i)
                if (strlen (ParamBaseTypeNameString (i)) == length
                    && ! strncmp (s, ParamBaseTypeNameString (i), length))
                    base = i;
            if (base == PT_UNKNOWN)
                return 0;
        }
        s += length;
    }
    long length = 1;
    const char *bracket = s + strspn (s, blanks);
    bool array = *bracket == '[';
    if (array) {
        char *end;
        length = strtol (bracket + 1, &end, 10);
        end += strspn (end, blanks);
        if (*end != ']' || end == bracket + 1 || length < 1 || length >= (1 << 18))
            return 0;
        s = end + 1;
    }
    basetype = base;
    arraylen = (unsigned int) length;
    isarray = array;
    interp = detail;
    reserved = 0;
    if (shortname) {
        const char *rest = s + strspn (s, blanks);
        size_t n = strlen (rest);
        while (n > 0 && strchr (blanks, rest[n-1]))
            --n;
        memmove (shortname, rest, n);
        shortname[n] = 0;
    }
    return (int) (s - typestring);
}

inline bool ParamType::tostring (char *typestring, int maxlen, bool showinterp) const
{
    static const char *const interps[4] = { "", "perpiece ", "linear ", "vertex " };
    if (! typestring || maxlen <= 0)
        return false;
    typestring[0] = 0;
    if (basetype == PT_UNKNOWN || basetype >= PT_LAST || interp > INTERP_VERTEX)
        return false;
    const char *detail = showinterp ? interps[interp] : "";
    char array[16] = "";
    if (isarray)
        snprintf (array, sizeof(array), "[%u]", (unsigned int) arraylen);
    int n = snprintf (typestring, maxlen, "%s%s%s", detail, ParamBaseTypeNameString (basetype), array);
    if (n >= 0 && n < maxlen)
        return true;
    typestring[0] = 0;
    return false;
}

} /* end namespace Gelato */

#endif /* !defined(GELATO_PARAMTYPE_H) */
