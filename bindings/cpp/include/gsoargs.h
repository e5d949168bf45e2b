// Parameters of compiled shaders. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GSOARGS_H
#define GSOARGS_H

#include <cstdlib>
#include <cstring>
#include <vector>

#include "export.h"
#include "gelato_c.h"
#include "paramtype.h"

namespace Gelato {

class GELATO_PUBLIC GsoArgs {
public:
    struct Parameter {
        const char *name;
        ParamType type;
        bool isoutput;
        bool valid;                          // true when a default value is known
        bool varlenarray;                    // true when an instance may have another length
        std::vector<float> fdefault;         // the floats of all elements
        std::vector<const char *> sdefault;  // the strings of all elements
        std::vector<const char *> spacename; // the space of each element of a triple or matrix
        std::vector<Parameter> metadata;
        Parameter() : name(NULL), type(PT_UNKNOWN), isoutput(false), valid(false), varlenarray(false) { }
    };

    GsoArgs () : _shadername(NULL), _shadertype(NULL), _error(NULL), _shader(NULL) {}
    ~GsoArgs () { gelato_shader_close (_shader); }

    // Searches `searchpath`, or "$GELATOHOME/shaders". Returns true when the shader was found and read.
    bool open (const char *shadername, const char *searchpath=NULL);

    // Returns "surface", "displacement", "volume", "light" or "shader".
    const char *shadertype (void) const { return _shadertype; }

    const char *shadername (void) const { return _shadername; }

    int nargs (void) const { return (int) args.size(); }

    // Return NULL when there is no such parameter.
    const Parameter *getarg (int i) const {
        if (i < 0 || i >= nargs())
            return NULL;
        return &(args[i]);
    }
    const Parameter *getarg (const char *name) const {
        for (unsigned int i = 0; i < args.size(); ++i)
            if (! strcmp (args[i].name, name))
                return &(args[i]);
        return NULL;
    }

    // Returns the metadata of the shader itself.
    const std::vector<Parameter> &metadata (void) const { return meta; }

    // Returns the error since the last call, or NULL.
    const char *error (void) {
        const char *e = _error;
        _error = NULL;
        return e;
    }

private:
    GsoArgs (const GsoArgs &);
    GsoArgs &operator= (const GsoArgs &);
    static void take (std::vector<Parameter> &list, const gelato_shader_parameter *from, int n);

    const char *_shadername;
    const char *_shadertype;
    const char *_error;
    std::vector<Parameter> args;
    std::vector<Parameter> meta;
    gelato_shader *_shader;
};

inline void GsoArgs::take (std::vector<Parameter> &list, const gelato_shader_parameter *from, int n)
{
    list.clear ();
    list.resize (n);
    for (int i = 0; i < n; ++i) {
        Parameter &p = list[i];
        p.name = from[i].name;
        memcpy ((void *) &p.type, &from[i].type, sizeof(p.type));
        p.isoutput = from[i].isoutput != 0;
        p.valid = from[i].valid != 0;
        p.varlenarray = from[i].varlenarray != 0;
        p.fdefault.assign (from[i].floats, from[i].floats + from[i].nfloats);
        p.sdefault.assign (from[i].strings, from[i].strings + from[i].nstrings);
        p.spacename.assign (from[i].spaces, from[i].spaces + from[i].nspaces);
        take (p.metadata, from[i].metadata, from[i].nmetadata);
    }
}

inline bool GsoArgs::open (const char *shadername, const char *searchpath)
{
    gelato_shader_close (_shader);
    gelato_shader_view view;
    _shader = gelato_shader_open (shadername, searchpath, &view);
    _shadername = view.name;
    _shadertype = view.type;
    _error = view.error;
    take (args, view.parameters, view.nparameters);
    take (meta, view.metadata, view.nmetadata);
    return _error == NULL;
}

} /* end namespace Gelato */

#endif /* GSOARGS_H */
