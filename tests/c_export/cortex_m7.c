// Start-up of the emulated Cortex-M7 (QEMU's mps2-an500), and what a step takes: instructions and stack.
//
// With `-icount shift=0` an instruction takes 1 ns of virtual time; SysTick counts at 25 MHz, once in 40 instructions.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define SYSTICK_CONTROL (*(volatile uint32_t*)0xE000E010U)
#define SYSTICK_RELOAD (*(volatile uint32_t*)0xE000E014U)
#define SYSTICK_VALUE (*(volatile uint32_t*)0xE000E018U)
#define COPROCESSOR_ACCESS (*(volatile uint32_t*)0xE000ED88U)

enum { INSTRUCTIONS_PER_TICK = 40, TICKS = 0x1000000, PAINTED_WORDS = 4096, PAINT_EVERY = 100 };
static const uint32_t kPaint = 0xA5C3A5C3U;

extern uint32_t stack_top;
int main(void);
void initialise_monitor_handles(void);
void step_begins(void);
void step_has_ended(void);
void report(void);
void _fini(void);

static uint64_t ticks, steps;
static uint32_t started, most_ticks, deepest;
static volatile uint32_t* painted;

void reset(void);

void reset(void) {
  COPROCESSOR_ACCESS |= 0xFU << 20;  // floating point
  __asm volatile("dsb\nisb");
  SYSTICK_RELOAD = TICKS - 1;
  SYSTICK_VALUE = 0;
  SYSTICK_CONTROL = 5;  // on, the processor's clock
  initialise_monitor_handles();
  exit(main());
}

static void fault(void) { _Exit(99); }

void _fini(void) {}  // exit() of newlib calls it

__attribute__((section(".vectors"), used)) static const void* const vectors[] = {&stack_top, reset, fault, fault,
                                                                                 fault,      fault, fault};

void step_begins(void) {
  painted = NULL;
  if (steps % PAINT_EVERY == 0) {
    volatile uint32_t here;
    painted = &here - 8 - PAINTED_WORDS;
    for (int i = 0; i < PAINTED_WORDS; ++i) painted[i] = kPaint;
  }
  started = SYSTICK_VALUE;
}

void step_has_ended(void) {
  const uint32_t taken = (started - SYSTICK_VALUE) % TICKS;
  ticks += taken;
  ++steps;
  if (taken > most_ticks) most_ticks = taken;
  if (!painted) return;
  int untouched = 0;
  while (untouched < PAINTED_WORDS && painted[untouched] == kPaint) ++untouched;
  const uint32_t used = 4U * (uint32_t)(PAINTED_WORDS + 8 - untouched);
  if (used > deepest) deepest = used;
}

void report(void) {
  FILE* to = fopen("figures.json", "w");
  if (!to) exit(7);
  fprintf(to, "{\"instructions\": %lu, \"most_instructions\": %lu, \"deepest_stack_bytes\": %lu}\n",
          (unsigned long)(ticks * INSTRUCTIONS_PER_TICK / steps), (unsigned long)most_ticks * INSTRUCTIONS_PER_TICK,
          (unsigned long)deepest);
  fclose(to);
}
