/* Steps an FMU of FMI 3.0: LIBRARY TOKEN TICK_S and value references: of inputs i, then
 * of whole inputs w, of outputs o; rows of doubles in, of which whole inputs take the whole part, and out. */
#include <stdio.h>
#include <stdlib.h>
#include "fmi3FunctionTypes.h"
#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#include <windows.h>
#define dlopen(path, how) ((void *)LoadLibraryA(path))
#define dlsym(library, name) ((void *)GetProcAddress((HMODULE)library, name))
#else
#include <dlfcn.h>
#endif
#define CALL(name) ((fmi3##name##TYPE *)dlsym(library, "fmi3" #name))

int main(int argc, char **argv)
{
    void *const library = dlopen(argv[1], RTLD_NOW);
    fmi3ValueReference in[256], out[256];
    fmi3UInt32 whole[256];
    fmi3Float64 x[256], y[256], end;
    fmi3Boolean b[3];
    int k, j, inputs = 0, wholes = 0, outputs = 0;
    fmi3Instance one;

#ifdef _WIN32
    _setmode(0, _O_BINARY), _setmode(1, _O_BINARY);
#endif
    for (k = 4; k < argc; ++k)
        *(argv[k][0] == 'i' ? &in[inputs++] : argv[k][0] == 'w' ? &in[inputs + wholes++] : &out[outputs++]) =
            (unsigned)atoi(argv[k] + 1);
    one = CALL(InstantiateCoSimulation)("one", argv[2], "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    if (!one || CALL(EnterInitializationMode)(one, 0, 0, 0, 0, 0) != fmi3OK)
        return 3;
    CALL(ExitInitializationMode)(one);
    for (k = 0; fread(x, sizeof *x, (size_t)(inputs + wholes), stdin) == (size_t)(inputs + wholes); ++k) {
        const double tick_s = atof(argv[3]);
        for (j = 0; j < wholes; ++j)
            whole[j] = (fmi3UInt32)x[inputs + j];
        if (CALL(SetFloat64)(one, in, (size_t)inputs, x, (size_t)inputs) != fmi3OK ||
                CALL(SetUInt32)(one, in + inputs, (size_t)wholes, whole, (size_t)wholes) != fmi3OK ||
                CALL(DoStep)(one, k * tick_s, tick_s, 1, b, b + 1, b + 2, &end) != fmi3OK ||
                CALL(GetFloat64)(one, out, (size_t)outputs, y, (size_t)outputs) != fmi3OK)
            return 4;
        fwrite(y, sizeof *y, (size_t)outputs, stdout);
    }
    CALL(FreeInstance)(one);
    return 0;
}
