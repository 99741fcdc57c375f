/* A board with two accelerometers around the firmware: an ATmega328P of simavr, its UART on a pseudo-terminal.
 *
 *     simavr_board ELF LINK SENSOR SECONDS SIGNAL RATE_HZ PACE [FAULT]
 *
 * SENSOR is 335 (analog), 345 or 355 (SPI); SIGNAL a file of float32 pairs, base and malleolus [m/s^2], repeated for
 * ever, or `count`: then the converter's reading says which conversion it is. PACE is `real`, or `fast`: as quick as the
 * reader of the terminal, who then never misses a byte. It ends after SECONDS of the board's time or when its standard
 * input closes, and prints one JSON object of what it saw. FAULT `dead1` cuts the cable of the malleolus.
 *
 * simavr's converter knows no start by timer 1, so that the compare match is handed to it here. Its own uart_pty drops
 * bytes when the reader is late, which a measurement of losses must not; so the terminal is served here, too.
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <pty.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_spi.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>
#include <simavr/sim_irq.h>
#include <simavr/sim_time.h>

#define CLOCK_HZ 16000000ul
#define COMPARE_B 12 /* its vector, TIMER1_COMPB */
#define G 9.80665

static avr_t *avr;
static int sensor, counting, master, dead = -1;
static float *signal_;
static size_t length;
static double rate_hz;
static avr_irq_t *adc, *spi, *uart;

/* ---- what was seen ---- */
static unsigned long conversions, bytes, dropped, conflicts;
static avr_cycle_count_t last, shortest = ~0ull, longest, first_byte;

static void seen(void) {
    if (last && conversions) {
        avr_cycle_count_t since = avr->cycle - last;
        shortest = since < shortest ? since : shortest;
        longest = since > longest ? since : longest;
    }
    last = avr->cycle;
    conversions++;
}

/* ---- the sensors ---- */
static int self_test[2];

static double acceleration(int channel, double seconds) {
    double at = fmod(seconds * rate_hz, length), part = at - floor(at);
    size_t i = (size_t)at % length, j = (i + 1) % length;
    return signal_[2 * i + channel] * (1 - part) + signal_[2 * j + channel] * part;
}

static double seconds_now(void) { return (double)avr->cycle / CLOCK_HZ; }

/* A conversion begins: the pin gets its voltage [mV] of this cycle. */
static void conversion(avr_irq_t *irq, uint32_t value, void *param) {
    unsigned kind = value & 7, pin = value >> 19; /* as avr_adc_mux_t has them */
    if (kind != ADC_MUX_SINGLE || pin > 1)
        return;
    double volts;
    if (!(avr->data[0x7A] & 0x20)) { /* not by the timer: the firmware looks at the sensors */
        conversions = last = 0;
        volts = 1.65 + 0.33 * (self_test[0] ? 1.0 : 0.0);
    } else if (counting) {
        int code = 230 + conversions * 7919 % 563;
        volts = ceil(code * 3300.0 / 1023) / 1e3;
        seen();
    } else {
        volts = 1.65 + 0.33 / G * acceleration(pin, seconds_now());
        seen();
    }
    if (pin == dead)
        volts = 0.01;
    volts = volts < 0 ? 0 : volts > 3.3 ? 3.3 : volts;
    avr_raise_irq(adc + ADC_IRQ_ADC0 + pin, (uint32_t)(1e3 * volts + 0.5));
}

static void compared(avr_irq_t *irq, uint32_t value, void *param) {
    if (value && sensor == 335)
        avr_raise_irq(adc + ADC_IRQ_IN_TRIGGER, 1);
}

/* Two chips on the SPI bus, by their data sheets: a transfer is an address and what follows. What is modelled of each
 * is what a firmware can get wrong: modes, range, data rate, who may be written when, and for the ADXL355 the step in
 * which it samples. Their own clocks are half a sample apart. */
static uint8_t registers[2][64];
static double pulse = -1; /* when D9 last rose [s] */
static int chosen = -1, address = -1, reading, several;

enum { RATE_345 = 0x2C, POWER_345 = 0x2D, FORMAT_345 = 0x31, Z_345 = 0x36 };
enum { Z_355 = 0x0E, FILTER_355 = 0x28, SYNC_355 = 0x2B, RANGE_355 = 0x2C, POWER_355 = 0x2D, TEST_355 = 0x2E };

static void power_up(int c) {
    uint8_t *r = registers[c];
    memset(r, 0, sizeof registers[c]);
    if (sensor == 345) {
        memcpy(r, "\xE5", 1);
        r[RATE_345] = 0x0A;
    } else {
        memcpy(r, "\xAD\x1D\xED", 3);
        r[RANGE_355] = 0x81;
        r[POWER_355] = 0x01;
    }
}

static double own_clock(int c, double odr) { return (floor(seconds_now() * odr + 0.5 * c) - 0.5 * c) / odr; }

static int clipped(double counts, int most) { return counts > most - 1 ? most - 1 : counts < -most ? -most : lround(counts); }

/* The data registers as they are now; a chip that does not measure, or waits for a pulse, keeps what it has. */
static void refresh_345(int c) {
    uint8_t *r = registers[c], format = r[FORMAT_345];
    if (!(r[POWER_345] & 0x08))
        return;
    int range = format & 3, full = format & 0x08;
    double odr = 3200.0 / (1 << (15 - (r[RATE_345] & 15)));
    double g = acceleration(c, own_clock(c, odr)) / G + (format & 0x80 ? 1.0 : 0.0);
    int counts = clipped(g * 256 / (full ? 1 : 1 << range), full ? 512 << range : 512);
    counts = format & 0x04 ? counts * (full ? 8 >> range : 64) : counts;
    r[Z_345] = counts;
    r[Z_345 + 1] = counts >> 8;
}

static void refresh_355(int c) {
    uint8_t *r = registers[c], step = r[SYNC_355] & 3, range = r[RANGE_355] & 3;
    if (r[POWER_355] & 1 || !range)
        return;
    if (step == 0 && !(r[POWER_355] & 4) && avr->data[0x24] & 2)
        conflicts++; /* its DRDY and D9 both drive the line between them */
    double at = step == 0 ? own_clock(c, 4000.0 / (1 << (r[FILTER_355] & 15))) : step == 2 ? pulse : -1;
    if (at < 0)
        return;
    double g = acceleration(c, at) / G + (r[TEST_355] == 3 ? 1.5 : 0.0);
    int counts = clipped(g * (512000 >> range), 1 << 19);
    r[Z_355] = counts >> 12;
    r[Z_355 + 1] = counts >> 4;
    r[Z_355 + 2] = counts << 4;
}

static void write_register(int c, uint8_t where, uint8_t value) {
    uint8_t *r = registers[c];
    if (sensor == 345 ? where < 0x1D || where == 0x2B || where == 0x30 || (where > 0x31 && where < 0x38)
                      : where < 0x12)
        return; /* is only read */
    if (sensor == 355 && where < POWER_355 && !(r[POWER_355] & 1))
        return; /* is set in standby only */
    r[where] = value;
}

/* D9, which timer 1 raises at each sample. */
static void stepped(avr_irq_t *irq, uint32_t value, void *param) {
    if (value)
        pulse = seconds_now();
}

static void select_chip(avr_irq_t *irq, uint32_t value, void *param) {
    int channel = (int)(long)param;
    if (!value) {
        chosen = channel;
        address = -1;
    } else if (chosen == channel)
        chosen = -1;
}

static void spi_byte(avr_irq_t *irq, uint32_t value, void *param) {
    uint8_t answer = 0xFF, mode = avr->data[0x4C] >> 2 & 3;
    if (chosen >= 0 && chosen != dead && mode == (sensor == 345 ? 3 : 0)) {
        if (address < 0) {
            address = sensor == 345 ? value & 0x3F : value >> 1 & 0x3F;
            reading = sensor == 345 ? value >> 7 : value & 1;
            several = sensor == 345 ? value >> 6 & 1 : 1;
            if (reading && address == (sensor == 345 ? Z_345 : Z_355)) {
                sensor == 345 ? refresh_345(chosen) : refresh_355(chosen);
                if (chosen == 0 && (avr->data[0x6F] & 4))
                    seen();
            }
        } else {
            if (reading)
                answer = sensor == 345 && registers[chosen][FORMAT_345] & 0x40 ? 0xFF : registers[chosen][address];
            else
                write_register(chosen, address, value);
            address = (address + several) & 0x3F;
        }
    }
    avr_raise_irq(spi + SPI_IRQ_INPUT, answer);
}

static void test_pin(avr_irq_t *irq, uint32_t value, void *param) { self_test[0] = value; }

/* simavr gives every byte 100 us, whatever the clock divider; at 4 MHz it has 32 cycles. */
static void spi_written(avr_t *a, avr_io_addr_t place, uint8_t value, void *param) {
    for (avr_cycle_timer_slot_p slot = a->cycle_timers.timer; slot; slot = slot->next)
        if (slot->param == param) {
            avr_cycle_timer_register(a, 32, slot->timer, param);
            return;
        }
}

/* ---- the line ---- */
static uint8_t waiting[1 << 20];
static size_t kept;
static int fast;

static void deliver(void) {
    while (kept) {
        ssize_t done = write(master, waiting, kept);
        if (done <= 0) {
            if (!fast)
                return;
            struct pollfd ends[2] = {{master, POLLOUT, 0}, {0, POLLIN, 0}};
            poll(ends, 2, 1000);
            if (ends[1].revents)
                return;
            continue;
        }
        kept -= done;
        memmove(waiting, waiting + done, kept);
    }
}

static void sent(avr_irq_t *irq, uint32_t value, void *param) {
    first_byte = bytes++ ? first_byte : avr->cycle;
    if (kept == sizeof waiting)
        dropped++;
    else
        waiting[kept++] = value;
}

static void quiet(avr_t *a, const int level, const char *format, va_list list) {}
static void no_sleep(avr_t *a, avr_cycle_count_t cycles) {}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int argc, char **argv) {
    if (argc < 8)
        return 2;
    sensor = atoi(argv[3]);
    double seconds = atof(argv[4]);
    rate_hz = atof(argv[6]);
    fast = !strcmp(argv[7], "fast");
    if (argc > 8 && !strcmp(argv[8], "dead1"))
        dead = 1;
    counting = !strcmp(argv[5], "count");
    if (!counting) {
        FILE *file = fopen(argv[5], "rb");
        if (!file)
            return 2;
        fseek(file, 0, SEEK_END);
        length = ftell(file) / 8;
        rewind(file);
        signal_ = malloc(8 * length);
        if (!length || fread(signal_, 8, length, file) != length)
            return 2;
        fclose(file);
    }
    FILE *out = fdopen(dup(1), "w"); /* simavr prints; what it says goes nowhere */
    if (!out || !freopen("/dev/null", "w", stdout))
        return 2;
    avr_global_logger_set(quiet);
    elf_firmware_t firmware = {};
    if (elf_read_firmware(argv[1], &firmware))
        return 2;
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    firmware.frequency = CLOCK_HZ;
    avr_load_firmware(avr, &firmware);
    avr->vcc = avr->avcc = 5000;
    avr->aref = 3300;
    avr->sleep = no_sleep;

    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    avr_irq_register_notify(uart + UART_IRQ_OUTPUT, sent, NULL);
    adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    avr_irq_register_notify(adc + ADC_IRQ_OUT_TRIGGER, conversion, NULL);
    avr_irq_register_notify(avr_get_interrupt_irq(avr, COMPARE_B), compared, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 4), test_pin, NULL);
    if (sensor != 335) {
        void *spi_module = NULL;
        spi = avr_io_getirq(avr, AVR_IOCTL_SPI_GETIRQ(0), 0);
        avr_irq_register_notify(spi + SPI_IRQ_OUTPUT, spi_byte, NULL);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 2), select_chip, (void *)0);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 0), select_chip, (void *)1);
        for (avr_io_t *io = avr->io_port; io; io = io->next)
            if (!strcmp(io->kind, "spi"))
                spi_module = io;
        avr_register_io_write(avr, 0x4E, spi_written, spi_module);
        avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), 1), stepped, NULL);
        power_up(0);
        power_up(1);
    }

    int slave;
    char name[128];
    struct termios raw;
    if (openpty(&master, &slave, name, NULL, NULL))
        return 2;
    tcgetattr(slave, &raw);
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    fcntl(master, F_SETFL, O_NONBLOCK);
    if (symlink(name, argv[2]))
        return 2;

    double start = now();
    avr_cycle_count_t end = (avr_cycle_count_t)(seconds * CLOCK_HZ), next = 0;
    while (avr->cycle < end && avr->state != cpu_Done && avr->state != cpu_Crashed) {
        if (avr->cycle >= next) {
            next = avr->cycle + CLOCK_HZ / 500;
            uint8_t byte;
            deliver();
            while (read(master, &byte, 1) == 1)
                avr_raise_irq(uart + UART_IRQ_INPUT, byte);
            double ahead = (double)avr->cycle / CLOCK_HZ - (now() - start);
            struct pollfd ends[1] = {{0, POLLIN, 0}};
            if (poll(ends, 1, fast || ahead < 1e-3 ? 0 : (int)(1e3 * ahead)) > 0 && read(0, &byte, 1) <= 0)
                break;
        }
        avr_run(avr);
    }
    deliver();
    unlink(argv[2]);
    fprintf(out,
            "{\"cycles\": %llu, \"conversions\": %lu, \"shortest_cycles\": %llu, \"longest_cycles\": %llu, "
            "\"bytes\": %lu, \"dropped\": %lu, \"conflicts\": %lu, \"first_byte_s\": %.6f, \"state\": %d, "
            "\"wall_s\": %.3f}\n",
            (unsigned long long)avr->cycle, conversions, (unsigned long long)shortest, (unsigned long long)longest,
            bytes, dropped, conflicts, (double)first_byte / CLOCK_HZ, avr->state, now() - start);
    fclose(out);
    if (fast)
        poll(NULL, 0, 500); /* the reader may still fetch what the terminal holds */
    return 0;
}
