/* Runs Blocks of a device's library.  On standard input, for each: a line with the names of its
 * functions and the bytes of its structs, then its parameters and its inputs; outputs go out. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <windows.h>
#define dlopen(path, how) ((void *)LoadLibraryA(path))
#define dlsym(library, name) ((void *)GetProcAddress((HMODULE)library, name))
#else
#include <dlfcn.h>
#endif

enum { PARAMS, COEFFS, STATE, GIVEN, MADE, STEPS, NUMBERS };

int main(int argc, char **argv)
{
    void *const library = dlopen(argv[argc - 1], RTLD_NOW);
    char line[512], stem[128], name[160];

#ifdef _WIN32
    _setmode(0, _O_BINARY), _setmode(1, _O_BINARY);
#endif
    while (fgets(line, sizeof line, stdin)) {
        void *call[3], *at[STEPS];
        unsigned n[NUMBERS];
        int i;

        sscanf(line, "%s %u %u %u %u %u %u", stem, n, n + 1, n + 2, n + 3, n + 4, n + 5);
        for (i = 0; i < 3; ++i) {
            sprintf(name, "%s_%s", stem, i == 0 ? "prepare" : i == 1 ? "init" : "run");
            if (!(call[i] = dlsym(library, name)) && (i > 0 || n[PARAMS]))
                return 3;
        }
        for (i = 0; i < STEPS; ++i)
            at[i] = calloc(i < GIVEN ? 1u : n[STEPS], n[i] + 8u);
        fread(at[PARAMS], 1, n[PARAMS], stdin);
        fread(at[GIVEN], n[GIVEN], n[STEPS], stdin);
        if (n[PARAMS]) {
            ((void (*)(void *, void *))call[0])(at[PARAMS], at[COEFFS]);
            ((void (*)(void *, void *))call[1])(at[COEFFS], at[STATE]);
            ((void (*)(void *, void *, void *, void *, void *, size_t))call[2])(
                    at[COEFFS], at[STATE], at[GIVEN], at[MADE], NULL, n[STEPS]);
        } else {
            ((void (*)(void *))call[1])(at[STATE]);
            ((void (*)(void *, void *, void *, void *, size_t))call[2])(
                    at[STATE], at[GIVEN], at[MADE], NULL, n[STEPS]);
        }
        fwrite(at[MADE], n[MADE], n[STEPS], stdout);
    }
    return 0;
}
