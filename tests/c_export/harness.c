// Plays inputs.bin through a diagnoser and writes what it says to outputs.bin: float64, one row a step, ports in order.
// -DDIAGNOSER=fdie -DVEHICLE=lab_x -include rotordx_fdie.h; with -DMEASURED, cortex_m7.c measures every step.
#include <stdio.h>

#define PASTE(a, b, c, d) a##b##c##d
#define JOIN(a, b, c, d) PASTE(a, b, c, d)
#define NAME(suffix) JOIN(rotordx_, DIAGNOSER, _, suffix)

#ifdef MEASURED
void step_begins(void);
void step_has_ended(void);
void report(void);
#else
#define step_begins()
#define step_has_ended()
#define report()
#endif

enum {
  INPUTS = sizeof(rotordx_inputs) / sizeof(rotordx_real),
  OUTPUTS = sizeof(NAME(outputs)) / sizeof(rotordx_real),
};

static NAME(state) state;
static NAME(outputs) outputs;

int main(void) {
  FILE* from = fopen("inputs.bin", "rb");
  FILE* to = fopen("outputs.bin", "wb");
  if (!from || !to) return 2;
  if (NAME(init)(&state, &NAME(VEHICLE), &outputs) != ROTORDX_OK) return 3;
  double row[INPUTS];
  while (fread(row, sizeof row, 1, from) == 1) {
    rotordx_inputs inputs;
    for (int i = 0; i < INPUTS; ++i) ((rotordx_real*)&inputs)[i] = (rotordx_real)row[i];
    step_begins();
    const rotordx_status status = NAME(step)(&state, &NAME(VEHICLE), &inputs, &outputs);
    step_has_ended();
    if (status != ROTORDX_OK) return 4;
    double said[OUTPUTS];
    for (int i = 0; i < OUTPUTS; ++i) said[i] = (double)((const rotordx_real*)&outputs)[i];
    if (fwrite(said, sizeof said, 1, to) != 1) return 5;
  }
  report();
  return fclose(to) ? 6 : 0;
}
