// LD_PRELOAD: reads of files whose path contains FAIL_UNDER fail with EIO: the FAIL_AT-th of each process, or with FAIL_AT=0 all
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
static long count;
static int fails(int fd){char l[64],p[600],*u=getenv("FAIL_UNDER"),*a=getenv("FAIL_AT");snprintf(l,64,"/proc/self/fd/%d",fd);
 ssize_t n=readlink(l,p,599);p[n<0?0:n]=0;if(!u||!a||!strstr(p,u))return 0;
 return atol(a)==0||__sync_add_and_fetch(&count,1)==atol(a);}
#define WRAP(name,args,call) ssize_t name args{static ssize_t(*f)args;if(!f)f=dlsym(RTLD_NEXT,#name);if(fails(fd)){errno=EIO;return -1;}return f call;}
WRAP(read,(int fd,void*b,size_t n),(fd,b,n))
WRAP(pread,(int fd,void*b,size_t n,off_t o),(fd,b,n,o))
WRAP(pread64,(int fd,void*b,size_t n,off64_t o),(fd,b,n,o))
