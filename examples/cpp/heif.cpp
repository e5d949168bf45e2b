// HEIF and AVIF images, read by the library libheif. heif.imageio.so reads "heic", "heif", "hif", "avif" and "avifs".
//     g++ -shared -fPIC -o heif.imageio.so -I$GELATOHOME/include heif.cpp -lheif
// The primary image comes first, and the others of the file follow.
#include <libheif/heif.h>

#include "imageio.h"

using namespace Gelato;

class HeifInput : public ImageInput {
public:
    HeifInput () : context (NULL), handle (NULL), image (NULL), current (0) {}
    ~HeifInput () { close (); }

    bool open (const char *name, ImageIOFormatSpec &newspec, int, const ImageIOParameter *) {
        context = heif_context_alloc ();
        if (! context || ! worked (heif_context_read_from_file (context, name, NULL)))
            return false;
        heif_item_id primary;
        if (! worked (heif_context_get_primary_image_ID (context, &primary)))
            return false;
        int n = heif_context_get_number_of_top_level_images (context);
        std::vector<heif_item_id> all (n > 0 ? n : 0);
        if (n > 0)
            heif_context_get_list_of_top_level_image_IDs (context, &all[0], n);
        ids.assign (1, primary);
        for (size_t i = 0; i < all.size (); ++i)
            if (all[i] != primary)
                ids.push_back (all[i]);
        return select (0, newspec);
    }

    int current_subimage () const { return current; }

    bool seek_subimage (int index, ImageIOFormatSpec &newspec) {
        return index >= 0 && (size_t) index < ids.size () && select (index, newspec);
    }

    bool read_native_scanline (int row, int, void *data) {
        if (! image && ! decode ())
            return false;
        int stride;
        const unsigned char *plane = heif_image_get_plane_readonly (image, heif_channel_interleaved, &stride);
        if (! plane || row < 0 || row >= spec.height || heif_image_get_primary_width (image) != spec.width
            || heif_image_get_primary_height (image) != spec.height) {
            error ("the image has another size than its description");
            return false;
        }
        plane += (ptrdiff_t) row * stride;
        int n = spec.width * spec.nchannels;
        if (spec.format == PT_UINT8) {
            memcpy (data, plane, n);
            return true;
        }
        // Little-endian numbers of 9 to 16 bits. Their high bits are repeated as the low ones.
        int bits = heif_image_get_bits_per_pixel_range (image, heif_channel_interleaved);
        for (int i = 0; i < n; ++i) {
            unsigned int v = plane[2 * i] | plane[2 * i + 1] << 8;
            ((unsigned short *) data)[i] = (unsigned short) (v << (16 - bits) | v >> (2 * bits - 16));
        }
        return true;
    }

    bool get_parameter (const char *name, ParamType type, void *value) {
        if (strcmp (name, "unassociatedalpha") || type.basetype != PT_INT || spec.nchannels != 4)
            return false;
        *(int *) value = ! heif_image_handle_is_premultiplied_alpha (handle);
        return true;
    }

    bool close () {
        release ();
        if (context)
            heif_context_free (context);
        context = NULL;
        return true;
    }

private:
    heif_context *context;
    heif_image_handle *handle;
    heif_image *image;
    std::vector<heif_item_id> ids;
    int current;

    bool worked (heif_error result) {
        if (result.code != heif_error_Ok)
            error ("%s", result.message);
        return result.code == heif_error_Ok;
    }

    void release () {
        if (image)
            heif_image_release (image);
        if (handle)
            heif_image_handle_release (handle);
        image = NULL;
        handle = NULL;
    }

    // Describes an image without decoding it.
    bool select (int index, ImageIOFormatSpec &newspec) {
        release ();
        if (! worked (heif_context_get_image_handle (context, ids[index], &handle)))
            return false;
        int bits = heif_image_handle_get_luma_bits_per_pixel (handle);
        if (bits < 1 || bits > 16) {
            error ("values of %d bits", bits);
            return false;
        }
        current = index;
        spec.width = spec.full_width = heif_image_handle_get_width (handle);
        spec.height = spec.full_height = heif_image_handle_get_height (handle);
        spec.depth = spec.full_depth = 1;
        spec.nchannels = heif_image_handle_has_alpha_channel (handle) ? 4 : 3;
        spec.format = bits > 8 ? PT_UINT16 : PT_UINT8;
        static const char *const names[] = { "R", "G", "B", "A" };
        spec.channelnames.assign (names, names + spec.nchannels);
        newspec = spec;
        return true;
    }

    bool decode () {
        bool alpha = spec.nchannels == 4;
        heif_chroma chroma = spec.format == PT_UINT8
            ? (alpha ? heif_chroma_interleaved_RGBA : heif_chroma_interleaved_RGB)
            : (alpha ? heif_chroma_interleaved_RRGGBBAA_LE : heif_chroma_interleaved_RRGGBB_LE);
        return worked (heif_decode_image (handle, &image, heif_colorspace_RGB, chroma, NULL));
    }
};

extern "C" {
GELATO_EXPORT int imageio_version = IMAGEIO_VERSION;
GELATO_EXPORT ImageInput *heif_input_imageio_create () { return new HeifInput; }
GELATO_EXPORT const char *heif_input_extensions[] = { "heic", "heif", "hif", "avif", "avifs", NULL };
}
