// Writes every call of the scene interface, in all forms of its values, into "calls.pyg". Invalid calls follow.
#include <stdio.h>
#include <stdexcept>

#include "gelatoapi.h"

using namespace Gelato;

class Two : public GelatoAPI::Generator {
public:
    void run (GelatoAPI *r, const char *) {
        r->Comment ("from a generator");
        r->Sphere (2);
    }
};

class Nest : public GelatoAPI::Generator {
public:
    void run (GelatoAPI *r, const char *) {
        r->Comment ("a nest");
        r->Input (new Two);
    }
};

class Bad : public GelatoAPI::Generator {
public:
    void run (GelatoAPI *, const char *) { throw std::runtime_error ("no such luck"); }
};

int main ()
{
    GelatoAPI *r = GelatoAPI::CreateRenderer ("calls.pyg");
    if (! r || GelatoAPI::CreateRenderer ("no such type"))
        return 1;
    const float M[16] = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1 };
    const float bound[6] = { -1, 1, -2, 2, -3, 3 };
    r->Comment ("%d of %s", 3, "them");
    r->Attribute ("fov", 45);
    r->Attribute ("float near", 0.25);
    r->Attribute ("far", ParamType (PT_FLOAT), 100.0f);
    int res[2] = { 64, 48 };
    r->Attribute ("resolution", &res);
    r->Attribute ("int[2] limits:bucketsize", res);
    float crop[4] = { 0, 0.5f, 0, 1 };
    r->Attribute ("crop", ParamType (PT_FLOAT, 4), crop);
    r->Attribute ("projection", "perspective");
    r->Attribute ("string user:name", "it");
    const char *words[2] = { "a", "b" };
    r->Attribute ("string[2] user:words", words);
    r->Attribute ("user:more", ParamType (PT_STRING, 2), words);
    r->Attribute ("user:color", ParamType (PT_COLOR), (const void *) crop);
    r->Attribute ("user:double", ParamType (PT_FLOAT), 0.5);
    r->Attribute ("user:int", ParamType (PT_INT), 7);
    r->Attribute ("user:text", ParamType (PT_STRING), "seven");
    r->Attribute ("user:ints", ParamType (PT_INT, 2), res);
    r->Camera ("main");
    r->Parameter ("float gain", 2.0);
    int quantize[4] = { 0, 255, 0, 255 };
    r->Parameter ("int[4] quantize", quantize);
    r->Output ("a.tif", "tiff", "rgba", "main");
    r->Output ("b.tif", NULL, "rgb", "main");
    r->World ();
    r->PushAttributes ();
    r->PushTransform ();
    r->SetTransform (M);
    r->SetTransform ("world");
    r->AppendTransform (M);
    r->Motion (2, 0.0, 0.5);
    r->Translate (1, 2, 3);
    r->Translate (2, 3, 4);
    const float times[3] = { 0, 0.25f, 1 };
    r->Motion (3, times);
    r->Rotate (90, 0, 0, 1);
    r->Rotate (91, 0, 0, 1);
    r->Rotate (92, 0, 0, 1);
    r->Scale (1, 2, 3);
    r->PopTransform ();
    r->SaveAttributes ("all");
    r->SaveAttributes ("some", "C,opacity");
    r->RestoreAttributes ("all");
    r->RestoreAttributes ("some", "C");
    r->ShaderGroupBegin ();
    r->Parameter ("Kd", ParamType (PT_FLOAT), 0.5);
    r->Shader ("surface", "plastic", "one");
    r->Shader ("surface", "matte", "two");
    r->ConnectShaders ("one", "C", "two", "tint");
    r->ShaderGroupEnd ();
    r->Parameter ("color lightcolor", crop);
    r->Light ("key", "pointlight");
    r->LightSwitch ("key", false);
    const float P[12] = { 0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0 };
    const int nverts[1] = { 4 }, verts[4] = { 0, 1, 2, 3 };
    r->Parameter ("vertex point P", P);
    r->Parameter ("s", ParamType (PT_FLOAT, INTERP_LINEAR), P);
    r->Parameter ("perpiece int id", nverts);
    r->Parameter ("constant string label", "face");
    r->Mesh ("catmull-clark", 1, nverts, verts);
    r->Parameter ("P", P);
    r->Points (4);
    r->Parameter ("P", P);
    r->Curves ("linear", 2, 2);
    const float knot[6] = { 0, 0, 0, 1, 1, 1 };
    r->Parameter ("P", P);
    r->Curves (1, 3, 3, knot, 0, 1);
    r->Parameter ("P", P);
    r->Patch ("linear", 2, 2);
    const int one[1] = { 1 }, three[1] = { 3 };
    const float min[1] = { 0 }, max[1] = { 1 };
    r->TrimCurve (1, one, three, three, knot, min, max, P);
    r->Parameter ("vertex hpoint Pw", M);
    r->Patch (2, 2, knot + 1, 0, 1, 2, 2, knot + 1, 0, 1);
    r->TrimCurve (0, NULL, NULL, NULL, NULL, NULL, NULL, NULL);
    r->Sphere (1, -1, 1);
    r->Sphere (3);
    r->Modify ("leg.*");
    r->PopAttributes ();
    r->Parameter ("string name", "x");
    r->Command ("mkdir");
    r->Input ("teapot.pyg");
    r->Input ("teapot.pyg", bound);
    // An archive contains the places of generators. "limits:inputlevels" is the number of their levels that are run
    // (4.3.12).
    r->Input (new Two);
    r->Input (new Two, bound);
    int levels = -1;
    if (! r->GetAttribute ("limits:inputlevels", levels) || levels != 0)
        return 3;
    r->Attribute ("limits:inputlevels", 1);
    r->Input (new Two);
    r->Input (new Two, bound);
    r->Input (new Nest);
    r->Attribute ("limits:inputlevels", 2);
    r->Input (new Nest);
    r->Render ("main");
    r->Render ();

    r->Parameter ("P", P);
    r->Mesh ("spline", 1, nverts, verts);
    r->Patch ("linear", -2, 2);
    r->Mesh ("linear", 1, NULL, verts);
    r->Parameter ("vertex point P", (const float *) NULL);
    r->Points (4);
    r->Parameter ("x", crop);
    r->Points (0);
    r->Parameter ("quux y", 1);
    r->Attribute (NULL, 1);
    r->Camera (NULL);
    r->SetTransform ((const float *) NULL);
    r->Input ((GelatoAPI::Generator *) NULL);
    r->Input (new Bad);
    r->Motion (-1, times);
    float value = 7;
    // In an archive, attributes have their defaults.
    if (! r->GetAttribute ("fov", value) || value != 90 || r->GetAttribute (NULL, value))
        return 2;
    r->Err ().Warning ("%s", "the end");
    delete r;
    return 0;
}
