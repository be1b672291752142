/* Simulates a file on a drive that does not respond: opening it blocks until this program's input ends.
 *
 * Holds a write lease on the file. An opening process waits until the holder releases the lease, or for
 * /proc/sys/fs/lease-break-time seconds (default 45).
 */
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

int main(int n_arguments, char **arguments) {
    char byte;
    if (n_arguments != 2) return 2;
    signal(SIGIO, SIG_IGN);
    int file = open(arguments[1], O_RDWR);
    int is_held = file >= 0 && fcntl(file, F_SETLEASE, F_WRLCK) == 0;
    puts(is_held ? "held" : "none");
    fflush(stdout);
    while (read(0, &byte, 1) > 0) {}
    return 0;
}
