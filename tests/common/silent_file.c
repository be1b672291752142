/* A file on a drive that does not answer: whoever opens it waits, until this program's input ends.
 *
 * It holds a lease of the file, which an opening breaks only when the holder lets it go (or after
 * /proc/sys/fs/lease-break-time seconds, 45 as systems come).
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
