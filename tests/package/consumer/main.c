/* Uses the installed library from C: prints its version. */
#include <gpurt.h>

#include <stdio.h>

int main(void)
{
  const uint32_t version = gpurt_version();
  printf("gpurt %u.%u.%u\n", (unsigned)(version >> 16), (unsigned)(version >> 8 & 255),
         (unsigned)(version & 255));
  return 0;
}
