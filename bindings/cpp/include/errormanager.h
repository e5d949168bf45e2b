// Messages of a renderer, and their receivers. SPDX-License-Identifier: MIT OR Apache-2.0

#ifndef GELATO_ERRORMANAGER_H
#define GELATO_ERRORMANAGER_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <string>

#include "export.h"
#include "gelato_c.h"

// Copies the values of a call. C++98 has no name for this.
#if defined(va_copy)
#define gelato_va_copy(to, from) va_copy (to, from)
#elif defined(__va_copy)
#define gelato_va_copy(to, from) __va_copy (to, from)
#else
#define gelato_va_copy(to, from) memcpy (&(to), &(from), sizeof(va_list))
#endif

namespace Gelato {

enum ErrCode {
    ERR_NO_ERROR=0,    // never passed to handlers
    ERR_INFO=512,
    ERR_WARNING=1024,
    ERR_ERROR=2048,
    ERR_SEVERE=4096,
    ERR_MESSAGE=8192   // requested output
};

enum VerbosityLevel {
    VERBOSITY_QUIET =0, // MESSAGE, SEVERE, ERROR
    VERBOSITY_NORMAL=1, // and WARNING
    VERBOSITY_INFO =2   // and INFO
};

// Receives messages, one at a time, from any thread. It is a base class.
class GELATO_PUBLIC ErrorHandler {
public:
    virtual ~ErrorHandler () {}
    virtual void operator() (ErrCode errcode, const char *msg) = 0;
};

// Sorts messages by severity, drops those that the verbosity excludes and repeated ones, and passes the rest to a
// handler. Renderers may share a manager. It is made by Create and ended by delete.
class GELATO_PUBLIC ErrorManager {
public:
    ~ErrorManager () { table->finish (self ()); }

    // Without a handler, messages go to standard error.
    static ErrorManager *Create (ErrorHandler *handler=NULL, int verbosity=VERBOSITY_NORMAL) {
        return reinterpret_cast<ErrorManager *> (gelato_create_errors (handler, verbosity));
    }

    void Info (const char *format, ...);
    void Warning (const char *format, ...);
    void Error (const char *format, ...);
    void Severe (const char *format, ...);
    void Message (const char *format, ...);

    void Verbosity (int verbosity) { table->set_verbosity (self (), verbosity); }
    int Verbosity () const { return table->verbosity (reinterpret_cast<const gelato_errors *> (this)); }

    // With NULL, messages go to standard error. The previous handler is not deleted.
    void Handler (ErrorHandler *handler) { table->set_handler (self (), handler); }
    ErrorHandler *Handler () const {
        return static_cast<ErrorHandler *> (table->handler (reinterpret_cast<const gelato_errors *> (this)));
    }

    // Returns the numbers of errors and warnings, and the repeated messages. The caller frees the text with free ().
    // Returns NULL when there is not enough memory.
    char *Summary () { return table->summary (self ()); }

    void operator delete (void *pMem, size_t) {
        gelato_errors *e = static_cast<gelato_errors *> (pMem);
        if (e)
            e->calls->release (e);
    }

protected:
    ErrorManager () : table (NULL) {}

private:
    gelato_errors *self () { return reinterpret_cast<gelato_errors *> (this); }
    void say (ErrCode code, const char *format, va_list values);

    const gelato_errors_calls *table;
};

// Returns the text of a format and its values.
inline std::string gelato_format (const char *format, va_list values)
{
    char small[512];
    va_list copy;
    gelato_va_copy (copy, values);
    int n = vsnprintf (small, sizeof(small), format ? format : "", values);
    std::string text;
    if (n >= (int) sizeof(small)) {
        text.resize ((size_t) n + 1);
        vsnprintf (&text[0], text.size (), format, copy);
        text.resize ((size_t) n);
    } else if (n > 0) {
        text.assign (small, (size_t) n);
    }
    va_end (copy);
    return text;
}

inline void ErrorManager::say (ErrCode code, const char *format, va_list values)
{
    table->say (self (), code, gelato_format (format, values).c_str ());
}

#define GELATO_SAY(name, code) \
    inline void ErrorManager::name (const char *format, ...) \
    { \
        va_list values; \
        va_start (values, format); \
        say (code, format, values); \
        va_end (values); \
    }
GELATO_SAY (Info, ERR_INFO)
GELATO_SAY (Warning, ERR_WARNING)
GELATO_SAY (Error, ERR_ERROR)
GELATO_SAY (Severe, ERR_SEVERE)
GELATO_SAY (Message, ERR_MESSAGE)
#undef GELATO_SAY

} /* end namespace Gelato */

#endif /* !defined(GELATO_ERRORMANAGER_H) */
