// Tests the functions that are inline in the headers: types, matrices, boxes, conversions of pixels.
#include <string.h>

#include "check.h"
#include "color.h"
#include "imageio.h"
#include "noise.h"
#include "paramtype.h"
#include "shadeop.h"
#include "vecmat.h"

using namespace Gelato;

// The names of older sources for exported symbols.
extern "C" {
EXPORT int shown_one = 1;
DLLEXPORT int shown_two (void) { return 2; }
}

// A reader of a few bytes. It is read through the conversions that every reader inherits.
class Bytes : public ImageInput {
public:
    bool open (const char *, ImageIOFormatSpec &newspec, int, const ImageIOParameter *) {
        spec.width = 2, spec.height = 1, spec.depth = 1, spec.nchannels = 2;
        spec.tile_width = 2, spec.tile_height = 1, spec.tile_depth = 1;
        spec.format = PT_UINT8;
        newspec = spec;
        return true;
    }
    bool read_native_scanline (int, int, void *data) {
        unsigned char bytes[4] = { 0, 51, 102, 255 };
        memcpy (data, bytes, 4);
        return true;
    }
    bool read_native_tile (int, int, int, void *data) { return read_native_scanline (0, 0, data); }
    bool close () { return true; }
    void half () { spec.format = PT_HALF, spec.nchannels = 1; }
};

class Halves : public Bytes {
public:
    bool read_native_scanline (int, int, void *data) {
        unsigned short bits[2] = { 0x3c00, 0xc000 };
        memcpy (data, bits, sizeof(bits));
        return true;
    }
};

int main ()
{
    char text[100], name[100];
    CHECK (sizeof(ParamType) == sizeof(int));
    ParamType t ("vertex float[3]");
    CHECK (t.basetype == PT_FLOAT && t.isarray && t.arraylen == 3 && t.interp == INTERP_VERTEX);
    CHECK (t.tostring (text, sizeof(text), true) && ! strcmp (text, "vertex float[3]"));
    CHECK (t.tostring (text, sizeof(text)) && ! strcmp (text, "float[3]"));
    CHECK (! t.tostring (text, 4) && t.tostring (text, 9));
    CHECK (t.datasize () == 12 && t.nfloats () == 3);
    CHECK (t.fromstring ("linear color Cs", name) == 12 && ! strcmp (name, "Cs") && t == ParamType (PT_COLOR, INTERP_LINEAR));
    CHECK (t.fromstring ("quux x") == 0 && t == ParamType (PT_COLOR, INTERP_LINEAR));
    CHECK (t.fromstring ("float[0] x") == 0 && t.fromstring ("float[ 2 ] crop", name) == 10 && t.arraylen == 2);
    CHECK (t.fromstring (NULL) == 0 && t.fromstring ("") == 0 && t.fromstring ("[3]") == 0);
    CHECK (ParamType ("nothing").basetype == PT_UNKNOWN && ! ParamType ("nothing").tostring (text, 100));
    for (int i = PT_VOID; i < PT_LAST; ++i)
        CHECK (ParamType (ParamBaseTypeNameString (i)) == ParamType ((ParamBaseType) i));
    CHECK (ParamBaseTypeSize (PT_MATRIX) == 64 && ParamBaseTypeNFloats (PT_HPOINT) == 4 && ! ParamBaseTypeNFloats (PT_INT));
    CHECK (PT_STRING == 2 && PT_FLOAT == 3 && PT_MATRIX == 11 && PT_UINT8 == 13 && PT_POINTER == 18);

    Bytes bytes;
    ImageIOFormatSpec spec;
    CHECK (bytes.open ("", spec, 0, NULL) && ! bytes.error_message ());
    float data[8] = { 9, 9, 9, 9, 9, 9, 9, 9 };
    CHECK (bytes.ImageInput::read_scanline (0, 0, data, 3));
    CHECK (data[0] == 0 && data[1] == 51 / 255.0f && data[2] == 9 && data[3] == 102 / 255.0f && data[4] == 1);
    CHECK (bytes.ImageInput::read_tile (0, 0, 0, data) && data[2] == 102 / 255.0f && data[3] == 1);
    Halves halves;
    halves.open ("", spec, 0, NULL);
    halves.half ();
    CHECK (halves.ImageInput::read_scanline (0, 0, data, 1) && data[0] == 1 && data[1] == -2);
    bytes.error ("%d of %s", 3, "them");
    CHECK (! strcmp (bytes.error_message (), "3 of them"));

    CHECK (ImageOutput::quantize (0.5f, 0, 255, 0, 255, 0) == 128 && ImageOutput::quantize (7, 0, 255, 0, 255, 0) == 255);
    CHECK (ImageOutput::quantize (-1, 0, 255, 0, 255, 0.5f) == 0 && ImageOutput::quantize (1, 0, 255, 0, 255, 0.5f) == 255);
    CHECK (ImageOutput::exposure (0.5f, 2, 1) == 1 && fabsf (ImageOutput::exposure (0.25f, 1, 0.5f) - 0.5f) < 1e-6f);
    int four[4] = { 1, 2, 3, 4 }, index = 7;
    const char *word = "w";
    const ImageIOParameter params[] = { ImageIOParameter ("quantize", PT_INT, 4, four), ImageIOParameter ("s", PT_STRING, 1, &word) };
    CHECK (IOParamFindValue ("quantize", PT_INT, 4, index, 2, params) == four && index == 0);
    CHECK (! IOParamFindValue ("quantize", PT_FLOAT, 4, index, 2, params) && index == -1);
    CHECK (IOParamFindString ("s", 2, params) == word && ! IOParamFindString ("t", 2, params));

    Matrix4 inverse, m = Matrix4::rotate (90, Vector3 (0, 0, 1)) * Matrix4::translate (1, 2, 3);
    Vector3 p = m.transformp (Vector3 (1, 0, 0));
    CHECK (fabsf (p.x - 1) < 1e-6f && fabsf (p.y - 3) < 1e-6f && p.z == 3);
    CHECK (m.inverse (inverse) && (inverse.transformp (p) - Vector3 (1, 0, 0)).length () < 1e-5f);
    CHECK (! Matrix4 (0.0f).inverse (inverse));
    CHECK (Matrix4 (0.0f).inverse () == Matrix4::Zero () && Matrix4 (1.0f) == Matrix4::Ident ());
    // An example of the reference writes a translation in this form (2.5).
    Matrix4 M(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1);
    CHECK (M == TranslationMatrix (3, 0, 0) && M == TranslationMatrix (Vector3 (3, 0, 0)));
    CHECK (((const float *)&M)[12] == 3 && sizeof(M) == 16 * sizeof(float));
    CHECK (transpose (M)[0][3] == 3 && M.transpose ()[0][3] == 3 && transpose (transpose (M)) == M);
    CHECK (Gelato::inverse (M) == TranslationMatrix (-3, 0, 0) && M * M.inverse () == Matrix4::Ident ());
    CHECK (ScaleMatrix (2) == ScaleMatrix (2, 2, 2) && ScaleMatrix (Vector3 (1, 2, 3))[2][2] == 3);
    CHECK (RotationMatrix (90, 0, 0, 1) == Matrix4::rotate (90, Vector3 (0, 0, 1)));
    CHECK (transformp (M, Vector3 (1, 1, 1)) == Vector3 (4, 1, 1) && transformv (M, Vector3 (1, 1, 1)) == Vector3 (1, 1, 1));
    // A non-uniform scale keeps normals perpendicular to their surface, but not vectors.
    Matrix4 flat = ScaleMatrix (2, 1, 1);
    CHECK (dot (flat.transformn (Vector3 (1, 1, 0)), flat.transformv (Vector3 (1, -1, 0))) == 0);
    CHECK (transformn (flat, Vector3 (1, 0, 0)) == Vector3 (0.5f, 0, 0));
    Vector3 v (3, 0, 4);
    CHECK (length (v) == 5 && normalize (v) == Vector3 (0.6f, 0, 0.8f) && normalize (Vector3::Zero ()) == Vector3 (0.0f));
    CHECK (v.normalize () == Vector3 (0.6f, 0, 0.8f) && v.x == 0.6f && distance (v, v) == 0);
    CHECK (lerp (1, 3, 0.25f) == 1.5f && lerp (Vector3 (0.0f), Vector3 (2.0f), 0.5f) == Vector3 (1.0f));
    CHECK (lerp (Color3 (0.0f), Color3 (1.0f), 0.25f).b == 0.25f && lerp (M, M, 0.5f) == M);
    M *= M;
    CHECK (M[3][0] == 6);
    Bbox3 box;
    CHECK (box.empty ());
    box.extend (Vector3 (1, 2, 3));
    CHECK (! box.empty () && box.contains (Vector3 (1, 2, 3)));
    CHECK (Color3 (1, 1, 1).luminance () > 0.9999f && mix (Color3 (0.0f), Color3 (1.0f), 0.25f).r == 0.25f);
    // Without a renderer the noise is 0.
    CHECK (Noise::noise (1.5f) == 0);
    return 0;
}
