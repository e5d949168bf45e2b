// The scene interface. SPDX-License-Identifier: MIT OR Apache-2.0
//
// The order of the virtual functions is the binary interface. It never changes.

#ifndef GELATOAPI_H
#define GELATOAPI_H

#include "export.h"
#include "paramtype.h"
#include "errormanager.h"

class GELATO_PUBLIC GelatoAPI {
public:
    GelatoAPI (void) {}
    virtual ~GelatoAPI (void) {}

    // Reads a scene file, or runs a generator or program. With a bound it may be read later, or never.
    virtual void Input (const char *filename) {}
    virtual void Input (const char *filename, const float *bound) {}

    virtual void Camera (const char *name) {}
    virtual void Output (const char *name, const char *format,
                         const char *dataname, const char *cameraname) {}
    virtual void World (void) {}
    virtual void Render (const char *cameraname=NULL) {}

    virtual void Motion (int ntimes, float time0, ...) {}
    virtual void Motion (int ntimes, const float *times) {}

    // Writes a comment into an archive.
    virtual void Comment (const char *format, ...) {}

    virtual void Command (const char *command) {}

    // Sets a parameter of the next shader, light, primitive, camera, output or command. Arrays are read by that call.
    virtual void Parameter (const char *name, Gelato::ParamType t, const void *val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, int val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, float val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, double val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, const char *val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, const int *val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, const float *val) {}
    virtual void Parameter (const char *name, Gelato::ParamType t, const char **val) {}
    virtual void Parameter (const char *typedname, const void *val) {}
    virtual void Parameter (const char *typedname, int val) {}
    virtual void Parameter (const char *typedname, float val) {}
    virtual void Parameter (const char *typedname, double val) {}
    virtual void Parameter (const char *typedname, const char *val) {}
    virtual void Parameter (const char *typedname, const int *val) {}
    virtual void Parameter (const char *typedname, const float *val) {}
    virtual void Parameter (const char *typedname, const char **val) {}

    virtual void Attribute (const char *name, Gelato::ParamType t, const void *val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, int val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, float val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, double val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, const char *val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, const int *val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, const float *val) {}
    virtual void Attribute (const char *name, Gelato::ParamType t, const char **val) {}
    virtual void Attribute (const char *typedname, const void *val) {}
    virtual void Attribute (const char *typedname, int val) {}
    virtual void Attribute (const char *typedname, float val) {}
    virtual void Attribute (const char *typedname, double val) {}
    virtual void Attribute (const char *typedname, const char *val) {}
    virtual void Attribute (const char *typedname, const int *val) {}
    virtual void Attribute (const char *typedname, const float *val) {}
    virtual void Attribute (const char *typedname, const char **val) {}

    // Returns true when there is an attribute of this name and type. Strings belong to the renderer.
    virtual bool GetAttribute (const char *name, void *val) { return false; }
    virtual bool GetAttribute (const char *name, int &val) { return false; }
    virtual bool GetAttribute (const char *name, float &val) { return false; }
    virtual bool GetAttribute (const char *name, double &val) { return false; }
    virtual bool GetAttribute (const char *name, char *&val) { return false; }
    virtual bool GetAttribute (const char *name, int *val) { return false; }
    virtual bool GetAttribute (const char *name, float *val) { return false; }
    virtual bool GetAttribute (const char *name, char **val) { return false; }

    virtual void PushAttributes (void) {}
    virtual void PopAttributes (void) {}
    virtual void SaveAttributes (const char *name, const char *attrs=NULL) {}
    virtual void RestoreAttributes (const char *name, const char *attrs=NULL) {}
    virtual void Modify (const char *namepattern=NULL) {}

    // Matrices are stored row by row, for row vectors.
    virtual void PushTransform (void) {}
    virtual void PopTransform (void) {}
    virtual void SetTransform (const float *M) {}
    virtual void SetTransform (const char *spacename) {}
    virtual void AppendTransform (const float *M) {}
    virtual void Translate (float x, float y, float z) {}
    virtual void Rotate (float angle, float x, float y, float z) {}
    virtual void Scale (float x, float y, float z) {}

    virtual void Shader (const char *shaderusage, const char *shadername=NULL,
                         const char *layername=NULL) {}
    virtual void Light (const char *lightid, const char *shadername,
                        const char *layername=NULL) {}
    virtual void ShaderGroupBegin (void) {}
    virtual void ShaderGroupEnd (void) {}
    virtual void ConnectShaders (const char *srclayer, const char *srcparam,
                                 const char *dstlayer, const char *dstparam) {}
    virtual void LightSwitch (const char *lightid, bool on) {}

    virtual void Points (int npoints) {}

    virtual void Curves (const char *interp, int ncurves, int nvertspercurve) {}
    virtual void Curves (int ncurves, int nvertspercurve, int order,
                         const float *knot, float vmin, float vmax) {}

    virtual void Patch (const char *interp, int nu, int nv) {}
    virtual void Patch (int nu, int uorder, const float *uknot,
                        float umin, float umax,
                        int nv, int vorder, const float *vknot,
                        float vmin, float vmax) {}
    virtual void TrimCurve (int nloops, const int *ncurves, const int *n,
                            const int *order, const float *knot,
                            const float *min, const float *max,
                            const float *uvw) {}

    virtual void Mesh (const char *interp, int nfaces,
                       const int *nverts, const int *verts) {}

    virtual void Sphere (float radius, float zmin, float zmax,
                         float thetamax=360) {}
    virtual void Sphere (float radius) { Sphere (radius, -radius, radius); }

    // Makes scene calls. A generator that is passed to Input belongs to the renderer.
    class GELATO_PUBLIC Generator {
    public:
        Generator () {}
        virtual ~Generator () {}
        // Stores the bound as xmin, xmax, ymin, ymax, zmin, zmax. Returns false when it is unknown.
        virtual bool bound (float *bbox) { return false; }
        virtual void run (GelatoAPI *renderer, const char *params) {}
    };

    // The library of a generator has: GELATO_EXPORT int generator_version = GelatoAPI::API_VERSION;
    static const int API_VERSION = 2;

    virtual void Input (Generator *procedure, const float *boundingbox=NULL) {}

    virtual Gelato::ErrorManager &Err (void) = 0;

    // Deprecated: use Err instead.
    virtual Gelato::ErrCode GetError (const char **errstrbuf=NULL) {
        return Gelato::ERR_NO_ERROR;
    }

    // The types are: none, "pyg", "pyg FILE", "FILE.pyg" and "remote". Without a manager of messages the renderer has
    // its own. Returns NULL when the renderer cannot be made.
    static GelatoAPI *CreateRenderer (const char *type=NULL,
                                      Gelato::ErrorManager *p_err=NULL) {
        return static_cast<GelatoAPI *> (
            gelato_create_renderer (type, reinterpret_cast<gelato_errors *> (p_err)));
    }

    // Renderers are freed by the library that made them.
    void operator delete (void *pMem, size_t) { ::operator delete (pMem); }
};

#endif /* !defined(GELATOAPI_H) */
